// `teres mesh` as a user runs it, on a box whose volume is known.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/case/case_reader.h"
#include "core/case/text_writer.h"
#include "tests/support/program.h"
#include "tools/meshing/tet_mesher.h"

namespace teres {
namespace {

using ::testing::HasSubstr;

// 40 x 30 x 20 mm
constexpr const char* kVertices =
    "v 0 0 0\nv 40 0 0\nv 40 30 0\nv 0 30 0\nv 0 0 20\nv 40 0 20\nv 40 30 20\nv 0 30 20\n";
constexpr const char* kSides = "f 1 4 3 2\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
constexpr const char* kTop = "f 5 6 7 8\n";

class MeshCommand : public ::testing::Test {
  protected:
    test::Run run(const std::string& obj, std::vector<std::string> more = {}) {
        EXPECT_TRUE(write_text_file(scratch.path() / "box.obj", obj));
        std::vector<std::string> words{"mesh",         (scratch.path() / "box.obj").string(),
                                       "-o",           out.string(),
                                       "--unit",       "mm",
                                       "--keep-edges", "40",
                                       "--tets",       "1500"};
        words.insert(words.end(), more.begin(), more.end());
        return test::run_teres(words);
    }
    test::ScratchFolder scratch;
    std::filesystem::path out = scratch.path() / "mesh.vtk";
};

TEST_F(MeshCommand, FillsABoxWithTheTetrahedraAskedFor) {
    const test::Run r = run(std::string(kVertices) + kSides + kTop);
    if (r.error.find("program 'gmsh' cannot be started") != std::string::npos)
        GTEST_SKIP() << "SKIPPED LOUDLY: " << r.error;
    ASSERT_EQ(r.exit_code, 0) << r.error;
    const auto mesh = read_vtk_tets(out);
    ASSERT_TRUE(mesh) << mesh.error().text;
    EXPECT_NEAR(static_cast<double>(mesh->tets.size()), 1500.0, 150.0);
    const MeshQuality q = measure_quality(*mesh);
    EXPECT_NEAR(q.volume_m3, 24e-6, 1e-4 * 24e-6);  // plane faces and kept edges: rounding of the file only
    EXPECT_GT(q.min_ratio, 0.15);
    EXPECT_GT(q.mean_ratio, 0.6);
}

TEST_F(MeshCommand, RefusesOpenAndSelfIntersectingSurfacesNamingThePlace) {
    const test::Run open = run(std::string(kVertices) + kSides);
    EXPECT_EQ(open.exit_code, 2);
    EXPECT_THAT(open.error, HasSubstr("the surface is open: 1 hole(s), 4 border edges, the first at ("));
    EXPECT_THAT(open.error, HasSubstr("--repair"));
    const test::Run repaired = run(std::string(kVertices) + kSides, {"--repair", "4"});
    EXPECT_NE(repaired.exit_code, 2) << repaired.error;
    // a spike from the bottom through the top
    std::string spike = std::string(kVertices) + "v 20 15 30\n" + kSides + kTop;
    spike.replace(spike.find("f 1 4 3 2\n"), 10, "f 1 4 9\nf 4 3 9\nf 3 2 9\nf 2 1 9\n");
    const test::Run cut = run(spike);
    EXPECT_EQ(cut.exit_code, 2);
    EXPECT_THAT(cut.error, HasSubstr("cuts itself: triangles"));
}

// Regular tetrahedron: ratio 1, dihedral angles arccos(1/3).
TEST(MeshQuality, OfTheRegularTetrahedronIsOne) {
    TetMeshData mesh;
    mesh.nodes = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
    mesh.tets = {{0, 1, 2, 3}};
    const MeshQuality q = measure_quality(mesh);
    EXPECT_NEAR(q.min_ratio, 1.0, 1e-12);
    EXPECT_NEAR(q.min_dihedral_deg, 70.528779, 1e-6);
    EXPECT_NEAR(q.max_dihedral_deg, 70.528779, 1e-6);
    EXPECT_NEAR(q.volume_m3, 8.0 / 3.0, 1e-12);
}

}  // namespace
}  // namespace teres
