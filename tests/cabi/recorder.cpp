// Recording through the C ABI: a whole file, no half file, and every kind of refusal.

#include "mesh.hpp"

#include <cfenv>
#include <dirent.h>
#include <fstream>
#include <unistd.h>

namespace
{

const m4gn_recorder_field recorded[] = {{"U", 3, {0, 1, -1, 0, 0, 0, 0}}, {"p", 1, {0, 2, -2, 0, 0, 0, 0}}};

m4gn_recorder_options options(const std::string& path)
{
    m4gn_recorder_options o{};
    o.path = path.c_str();
    o.n_fields = 2;
    o.fields = recorded;
    o.provenance = "{\"application\": \"a test\"}";
    o.split = "test";
    return o;
}

// With . and ..
int filesIn(const std::string& folder)
{
    int count = 0;
    DIR* directory = opendir(folder.c_str());
    REQUIRE(directory);
    while (readdir(directory))
    {
        ++count;
    }
    closedir(directory);
    return count;
}

} // namespace

int main()
{
    const int traps = FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW;
    feenableexcept(traps);

    char folderName[] = "recorder-XXXXXX";
    REQUIRE(mkdtemp(folderName));
    const std::string folder(folderName);
    const std::string path = folder + "/a.h5";
    const int empty = filesIn(folder);
    Channel mesh(6, 4);
    Fields fields(mesh);
    std::string message;

    {
        m4gn::Recorder recorder(M4GN_NO_MPI, mesh.data, options(path));
        recorder.append(0.1, fields.in());
        recorder.append(0.2, fields.in());
        REQUIRE(recorder.nFrames() == 2);

        // What is refused leaves the recording as it was.
        REQUIRE(failure(message, [&] { recorder.append(0.2, fields.in()); }) == M4GN_ERROR_INPUT);
        REQUIRE(failure(message, [&] { recorder.append(0.3, {fields.in()[0]}); }) == M4GN_ERROR_INPUT);
        REQUIRE(contains(message, "p"));
        auto wrong = fields.in();
        wrong[0].components = 1;
        REQUIRE(failure(message, [&] { recorder.append(0.3, wrong); }) == M4GN_ERROR_INPUT);
        wrong = fields.in();
        wrong[0].cells = nullptr;
        REQUIRE(failure(message, [&] { recorder.append(0.3, wrong); }) == M4GN_ERROR_INPUT);
        Fields bad(mesh);
        bad.p[3] = NAN;
        REQUIRE(failure(message, [&] { recorder.append(0.3, bad.in()); }) == M4GN_ERROR_NUMERICAL);
        REQUIRE(recorder.nFrames() == 2);

        REQUIRE(access(path.c_str(), F_OK) != 0);
        recorder.finish();
        REQUIRE(access(path.c_str(), F_OK) == 0);
        REQUIRE(failure(message, [&] { recorder.append(0.4, fields.in()); }) > 0);
    }
    REQUIRE(filesIn(folder) == empty + 1);

    // Dropped before it is finished: nothing is left.
    {
        m4gn::Recorder recorder(M4GN_NO_MPI, mesh.data, options(folder + "/b.h5"));
        recorder.append(0.1, fields.in());
    }
    REQUIRE(filesIn(folder) == empty + 1);

    const auto refused = [&](const m4gn_recorder_options& o)
    {
        return failure(message, [&] { m4gn::Recorder(M4GN_NO_MPI, mesh.data, o); });
    };
    REQUIRE(refused(options(path)) == M4GN_ERROR_FILE);
    REQUIRE(contains(message, "a.h5"));
    auto o = options(path);
    o.overwrite = 1;
    REQUIRE(refused(o) == M4GN_OK);
    const std::string nowhere = path + "/in-a-file.h5";
    REQUIRE(refused(options(nowhere)) == M4GN_ERROR_FILE);
    const std::string fresh = folder + "/d.h5";
    o = options(fresh);
    o.split = "holiday";
    REQUIRE(refused(o) == M4GN_ERROR_INPUT);
    o = options(fresh);
    o.provenance = "not JSON";
    REQUIRE(refused(o) == M4GN_ERROR_INPUT);
    o = options(fresh);
    o.n_fields = 0;
    REQUIRE(refused(o) == M4GN_ERROR_INPUT);
    o = options(fresh);
    o.path = nullptr;
    REQUIRE(refused(o) == M4GN_ERROR_INPUT);
    mesh.data.face_owner = nullptr;
    REQUIRE(refused(options(fresh)) == M4GN_ERROR_INPUT);

    REQUIRE(fegetexcept() == traps);
    REQUIRE(filesIn(folder) == empty + 1);
    std::remove(path.c_str());
    rmdir(folder.c_str());
    std::puts("recorder: ok");
    return 0;
}
