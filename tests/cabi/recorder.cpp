// Recording through the C ABI: a whole file, no half file, and every kind of refusal.

#include "mesh.hpp"

#include <cfenv>
#include <dirent.h>
#include <fstream>
#include <unistd.h>

namespace
{

const std::vector<m4gn_field_info> recorded{
    {"U", 3, {0, 1, -1, 0, 0, 0, 0}, 0, 0}, {"p", 1, {0, 2, -2, 0, 0, 0, 0}, 0, 0}};

std::string options(const std::string& path, const std::string& more = R"("split": "test")")
{
    return "{\"path\": " + m4gn::quoted(path) + ", " + more + "}";
}

// With . and ..
int filesIn(const std::string& folder)
{
    int count = 0;
    DIR* directory = opendir(folder.c_str());
    REQUIRE(directory);
    while (readdir(directory)) {
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
        m4gn::Recorder recorder(
            M4GN_NO_MPI, mesh.data, options(path, R"("provenance": {"application": "a test"})"), recorded);
        const auto append = [&](double time, const Fields& f) {
            recorder.append(time, f.cells(), f.boundary());
        };
        append(0.1, fields);
        append(0.2, fields);
        REQUIRE(recorder.nFrames() == 2);

        // What is refused leaves the recording as it was.
        REQUIRE(failure(message, [&] { append(0.2, fields); }) == M4GN_ERROR_INPUT);
        const auto refuses = [&](std::vector<const double*> cells, std::vector<const double*> boundary) {
            return failure(message, [&] { recorder.append(0.3, cells, boundary); });
        };
        REQUIRE(refuses({fields.U.data()}, fields.boundary()) == M4GN_ERROR_INPUT);
        REQUIRE(refuses({fields.U.data(), nullptr}, fields.boundary()) == M4GN_ERROR_INPUT);
        REQUIRE(contains(message, "p"));
        REQUIRE(refuses(fields.cells(), {nullptr, fields.pBoundary.data()}) == M4GN_ERROR_INPUT);
        REQUIRE(contains(message, "U"));
        Fields bad(mesh);
        bad.p[3] = NAN;
        REQUIRE(failure(message, [&] { append(0.3, bad); }) == M4GN_ERROR_NUMERICAL);
        bad = fields;
        bad.UBoundary[0] = INFINITY;
        REQUIRE(failure(message, [&] { append(0.3, bad); }) == M4GN_ERROR_NUMERICAL);
        REQUIRE(failure(message, [&] { append(NAN, fields); }) == M4GN_ERROR_INPUT);
        REQUIRE(recorder.nFrames() == 2);

        REQUIRE(access(path.c_str(), F_OK) != 0);
        recorder.finish();
        REQUIRE(access(path.c_str(), F_OK) == 0);
        REQUIRE(failure(message, [&] { append(0.4, fields); }) > 0);
    }
    REQUIRE(filesIn(folder) == empty + 1);

    // Dropped before it is finished: nothing is left.
    {
        m4gn::Recorder recorder(M4GN_NO_MPI, mesh.data, options(folder + "/b.h5"), recorded);
        recorder.append(0.1, fields.cells(), fields.boundary());
    }
    REQUIRE(filesIn(folder) == empty + 1);

    auto given = recorded;
    const auto refused = [&](const std::string& o) {
        return failure(message, [&] { m4gn::Recorder(M4GN_NO_MPI, mesh.data, o, given); });
    };
    REQUIRE(refused(options(path)) == M4GN_ERROR_FILE);
    REQUIRE(contains(message, "a.h5"));
    REQUIRE(refused(options(path, R"("overwrite": true)")) == M4GN_OK);
    const std::string nowhere = path + "/in-a-file.h5";
    REQUIRE(refused(options(nowhere)) == M4GN_ERROR_FILE);
    const std::string fresh = folder + "/d.h5";
    REQUIRE(refused(options(fresh, R"("split": "holiday")")) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "split: expected one of train, valid, test, found holiday"));
    REQUIRE(refused(options(fresh, R"("provenance": "none")")) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "provenance: expected a map"));
    REQUIRE(refused("{}") == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "missing field path"));
    given.clear();
    REQUIRE(refused(options(fresh)) == M4GN_ERROR_INPUT);
    given = recorded;
    given[1].components = 2;
    REQUIRE(refused(options(fresh)) == M4GN_ERROR_INPUT);
    given[1] = given[0];
    REQUIRE(refused(options(fresh)) == M4GN_ERROR_INPUT);
    given[1].name = nullptr;
    REQUIRE(refused(options(fresh)) == M4GN_ERROR_INPUT);
    given = recorded;
    mesh.data.face_owner = nullptr;
    REQUIRE(refused(options(fresh)) == M4GN_ERROR_INPUT);

    REQUIRE(fegetexcept() == traps);
    REQUIRE(filesIn(folder) == empty + 1);
    std::remove(path.c_str());
    rmdir(folder.c_str());
    std::puts("recorder: ok");
    return 0;
}
