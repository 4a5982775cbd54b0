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
        REQUIRE(fails(M4GN_ERROR_INPUT, {}, [&] { append(0.2, fields); }));
        using List = std::vector<const double*>;
        const auto refused = [&](const List& cells, const List& boundary, Texts texts = {}) {
            return fails(M4GN_ERROR_INPUT, texts, [&] { recorder.append(0.3, cells, boundary); });
        };
        REQUIRE(refused({fields.U.data()}, fields.boundary()));
        REQUIRE(refused({fields.U.data(), nullptr}, fields.boundary(), {"p"}));
        REQUIRE(refused(fields.cells(), {nullptr, fields.pBoundary.data()}, {"U"}));
        Fields bad(mesh);
        bad.p[3] = NAN;
        REQUIRE(fails(M4GN_ERROR_NUMERICAL, {}, [&] { append(0.3, bad); }));
        bad = fields;
        bad.UBoundary[0] = INFINITY;
        REQUIRE(fails(M4GN_ERROR_NUMERICAL, {}, [&] { append(0.3, bad); }));
        REQUIRE(fails(M4GN_ERROR_INPUT, {}, [&] { append(NAN, fields); }));
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

    auto infos = recorded;
    const auto refused = [&](int32_t status, const std::string& o, Texts texts = {}) {
        return fails(status, texts, [&] { m4gn::Recorder(M4GN_NO_MPI, mesh.data, o, infos); });
    };
    REQUIRE(refused(M4GN_ERROR_FILE, options(path), {"a.h5"}));
    REQUIRE(refused(M4GN_OK, options(path, R"("overwrite": true)")));
    REQUIRE(refused(M4GN_ERROR_FILE, options(path + "/in-a-file.h5")));
    const std::string fresh = folder + "/d.h5";
    const auto input = M4GN_ERROR_INPUT;
    REQUIRE(refused(
        input, options(fresh, R"("split": "holiday")"),
        {"split: expected one of train, valid, test, found holiday"}));
    REQUIRE(refused(input, options(fresh, R"("provenance": "none")"), {"provenance: expected a map"}));
    REQUIRE(refused(input, "{}", {"missing field path"}));
    infos.clear();
    REQUIRE(refused(input, options(fresh)));
    infos = recorded;
    infos[1].components = 2;
    REQUIRE(refused(input, options(fresh)));
    infos[1] = infos[0];
    REQUIRE(refused(input, options(fresh)));
    infos[1].name = nullptr;
    REQUIRE(refused(input, options(fresh)));
    infos = recorded;
    mesh.data.face_owner = nullptr;
    REQUIRE(refused(input, options(fresh)));

    REQUIRE(fegetexcept() == traps);
    REQUIRE(filesIn(folder) == empty + 1);
    std::remove(path.c_str());
    rmdir(folder.c_str());
    std::puts("recorder: ok");
    return 0;
}
