// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "emptyPolyPatch.H"
#include "fvMesh.H"
#include "IStringStream.H"
#include "OSspecific.H"
#include <fstream>
#include <iostream>
#include <map>
#include <regex>
#include <stdexcept>
#include <stdlib.h>

namespace
{
std::map<std::string, void (*)()>& tests()
{
    static std::map<std::string, void (*)()> all;
    return all;
}
} // End anonymous namespace

testing::registration::registration(const char* name, void (*run)()) { tests()[name] = run; }

void testing::failed(const char* file, int line, const std::string& what)
{
    throw std::runtime_error(std::string(file) + ":" + std::to_string(line) + ": " + what);
}

void testing::near(scalar found, scalar expected, scalar tolerance, const char* file, int line)
{
    if (!(mag(found - expected) <= tolerance)) {
        std::ostringstream os;
        os.precision(17);
        os << "expected " << expected << " to " << tolerance << ", found " << found;
        failed(file, line, os.str());
    }
}

void testing::near(const vector& found, const vector& expected, scalar tolerance, const char* file, int line)
{
    for (direction cmpt = 0; cmpt < vector::nComponents; ++cmpt) {
        near(found[cmpt], expected[cmpt], tolerance, file, line);
    }
}

void testing::refused(const std::function<void()>& call, const std::string& text, const char* file, int line)
{
    std::string message;
    try {
        call();
    } catch (const Foam::error& e) {
        message = e.message();
    }
    if (message.find(text) == std::string::npos) {
        failed(file, line, "expected an error with '" + text + "', found '" + message + "'");
    }
}

Foam::dictionary testing::dict(const std::string& text)
{
    IStringStream is(text);
    dictionary made(is);
    made.name() = "test";
    return made;
}

testing::caseFolder::caseFolder()
{
    char name[] = "/tmp/m4gnXXXXXX";
    if (!::mkdtemp(name)) {
        throw std::runtime_error("no folder for a case in /tmp");
    }
    folder_ = name;

    write(
        "system/fvSchemes",
        "ddtSchemes { default Euler; } gradSchemes { default Gauss linear; }"
        " divSchemes { default Gauss linear; } laplacianSchemes { default Gauss linear corrected; }"
        " interpolationSchemes { default linear; } snGradSchemes { default corrected; }");
    write(
        "system/fvSolution",
        "solvers { p { solver PCG; preconditioner DIC; tolerance 1e-12; relTol 0; } } PISO {}");
    const dictionary control(
        dict("startFrom startTime; startTime 0; stopAt endTime; endTime 1; deltaT 0.1;"
             " writeControl timeStep; writeInterval 1; writeFormat ascii; writePrecision 12;"));
    time_.reset(new Time(control, folder_.path(), folder_.name()));
}

testing::caseFolder::~caseFolder()
{
    time_.clear();
    rmDir(folder_);
}

void testing::caseFolder::write(const fileName& path, const std::string& text) const
{
    const fileName file(folder_ / path);
    mkDir(file.path());
    std::ofstream os(file);
    os << "FoamFile { version 2.0; format ascii; class dictionary; object " << file.name() << "; }\n"
       << text << '\n';
}

Foam::autoPtr<Foam::fvMesh> testing::caseFolder::block(
    const Vector<label>& n, const vector& size, const wordList& types)
{
    const auto cell = [&](label i, label j, label k) { return i + n[0] * (j + n[1] * k); };
    const auto point = [&](label i, label j, label k) { return i + (n[0] + 1) * (j + (n[1] + 1) * k); };

    pointField points((n[0] + 1) * (n[1] + 1) * (n[2] + 1));
    for (label k = 0; k <= n[2]; ++k) {
        for (label j = 0; j <= n[1]; ++j) {
            for (label i = 0; i <= n[0]; ++i) {
                points[point(i, j, k)] = vector(size[0] * i / n[0], size[1] * j / n[1], size[2] * k / n[2]);
            }
        }
    }

    // The face of a cell's upper (or lower) side in a direction, its normal outwards
    const auto side = [&](const label at[3], const direction d, const bool upper) {
        const direction e = (d + 1) % 3, f = (d + 2) % 3;
        face made(4);
        for (label c = 0; c < 4; ++c) {
            label p[3] = {at[0], at[1], at[2]};
            p[d] += upper;
            p[e] += c == 1 || c == 2;
            p[f] += c >= 2;
            made[upper ? c : 3 - c] = point(p[0], p[1], p[2]);
        }
        return made;
    };

    DynamicList<face> faces;
    DynamicList<label> owner, neighbour;
    label at[3];
    const auto eachCell = [&](const std::function<void()>& visit) {
        for (at[2] = 0; at[2] < n[2]; ++at[2]) {
            for (at[1] = 0; at[1] < n[1]; ++at[1]) {
                for (at[0] = 0; at[0] < n[0]; ++at[0]) {
                    visit();
                }
            }
        }
    };

    eachCell([&] {
        for (direction d = 0; d < 3; ++d) {
            if (at[d] + 1 < n[d]) {
                label other[3] = {at[0], at[1], at[2]};
                ++other[d];
                faces.append(side(at, d, true));
                owner.append(cell(at[0], at[1], at[2]));
                neighbour.append(cell(other[0], other[1], other[2]));
            }
        }
    });

    labelList starts(7, faces.size());
    for (label patchi = 0; patchi < 6; ++patchi) {
        const direction d = patchi / 2;
        const bool upper = patchi % 2;
        eachCell([&] {
            if (at[d] == (upper ? n[d] - 1 : 0)) {
                faces.append(side(at, d, upper));
                owner.append(cell(at[0], at[1], at[2]));
            }
        });
        starts[patchi + 1] = faces.size();
    }

    autoPtr<fvMesh> mesh(new fvMesh(
        IOobject(
            fvMesh::defaultRegion, time_->timeName(), *time_, IOobject::READ_IF_PRESENT, IOobject::NO_WRITE),
        std::move(points), faceList(faces), labelList(owner), labelList(neighbour)));

    const wordList names({"left", "right", "bottom", "top", "back", "front"});
    List<polyPatch*> patches(6);
    forAll(patches, i) {
        // Cyclic ones have that of the other side for neighbour
        dictionary patch(dict("neighbourPatch " + names[i % 2 ? i - 1 : i + 1] + ';'));
        patch.set("type", types[i]);
        patch.set("nFaces", starts[i + 1] - starts[i]);
        patch.set("startFace", starts[i]);
        patches[i] = polyPatch::New(names[i], patch, i, mesh->boundaryMesh()).ptr();
    }
    mesh->addFvPatches(patches);

    return mesh;
}

//- The test of this name
int main(int argc, char* argv[])
{
    const auto found = argc == 2 ? tests().find(argv[1]) : tests().end();
    if (found == tests().end()) {
        std::cerr << "expected the name of one test:\n";
        for (const auto& test : tests()) {
            std::cerr << "    " << test.first << '\n';
        }
        return 2;
    }

    Foam::FatalError.throwExceptions();
    Foam::FatalIOError.throwExceptions();
    try {
        found->second();
    } catch (const Foam::error& e) {
        std::cerr << "FatalError: " << e.message() << '\n';
        return 1;
    } catch (const std::exception& e) {
        std::cerr << e.what() << '\n';
        return 1;
    }
    return 0;
}
