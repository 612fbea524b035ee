// Surfaces, registration and the atlas against shapes whose answer is known, and against the independent
// livers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numbers>

#include "core/case/text_writer.h"
#include "tests/support/program.h"
#include "tests/support/test_data.h"
#include "tools/atlas/ligament_atlas.h"

namespace teres {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

TriangleSurface octahedron(double radius) {
    TriangleSurface s;
    s.V.resize(3, 6);
    s.V << 1, -1, 0, 0, 0, 0, 0, 0, 1, -1, 0, 0, 0, 0, 0, 0, 1, -1;
    s.V *= radius;
    s.F = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
    return s;
}

TriangleSurface sphere(double radius, int rounds) {
    TriangleSurface s = octahedron(1.0);
    for (int i = 0; i < rounds; ++i) s = subdivided(s);
    s.V.colwise().normalize();
    s.V *= radius;
    return s;
}

// A lopsided body: no symmetry, so that turned and mirrored copies differ.
TriangleSurface lopsided() {
    TriangleSurface s = sphere(1.0, 4);
    for (Eigen::Index v = 0; v < s.num_vertices(); ++v) {
        const Vector3d d = s.V.col(v);
        const double bulge = 0.5 * std::exp(4.0 * (d.dot(Vector3d(1, 0.3, 0.2).normalized()) - 1.0)) +
                             0.4 * std::exp(6.0 * (d.dot(Vector3d(-0.3, 1, -0.5).normalized()) - 1.0)) -
                             0.2 * std::exp(6.0 * (d.dot(Vector3d(-0.5, -0.2, 1).normalized()) - 1.0));
        s.V.col(v) = 0.08 * (1.0 + bulge) * Vector3d(1.3 * d[0], 0.8 * d[1], d[2]);
    }
    return s;
}

TEST(TriangleSurface, MeasuresOfASphereConverge) {
    const TriangleSurface s = sphere(0.1, 5);
    const double pi = std::numbers::pi;
    EXPECT_NEAR(signed_volume(s), 4.0 / 3.0 * pi * 1e-3,
                0.005 * 4.0 / 3.0 * pi * 1e-3);  // inscribed: O(edge^2)
    EXPECT_NEAR(vertex_areas(s).sum(), 4.0 * pi * 1e-2, 0.005 * 4.0 * pi * 1e-2);
}

TEST(ClosestPointSearch, EqualsTheSearchOfAllTriangles) {
    const TriangleSurface s = lopsided();
    const ClosestPointSearch search(s);
    std::srand(1);
    for (int i = 0; i < 50; ++i) {
        const Vector3d query = 0.2 * Vector3d::Random();
        double best = 1e9;  // a fine sampling of every triangle never beats the exact point
        for (std::size_t f = 0; f < s.F.size(); ++f)
            for (int a = 0; a <= 8; ++a)
                for (int b = 0; a + b <= 8; ++b)
                    best = std::min(
                        best, (query - (a * s.corner(f, 0) + b * s.corner(f, 1) + (8 - a - b) * s.corner(f, 2)) / 8.0)
                                  .norm());
        const double found = search.closest(query).distance;
        EXPECT_LE(found, best + 1e-12);
        EXPECT_GT(found, best - 0.001);  // edges are 10 mm
    }
}

TEST(TriangleSurface, SimplifiedStaysClosedAndKeepsItsVolume) {
    const TriangleSurface s = lopsided();
    TriangleSurface coarse = simplified(s, 400);
    EXPECT_EQ(coarse.num_vertices(), 400);
    EXPECT_TRUE(check_closed(coarse, "coarse", 1.0));
    EXPECT_NEAR(signed_volume(coarse), signed_volume(s), 0.05 * signed_volume(s));
}

TEST(TriangleSurface, DefectsAreNamed) {
    TriangleSurface open = octahedron(0.1);
    open.F.pop_back();
    EXPECT_THAT(check_closed(open, "liver.obj", 1e-3).error().text, HasSubstr("open: 1 hole(s), 3 border edges"));
    TriangleSurface two = octahedron(0.1);
    two.V.conservativeResize(3, 12);
    two.V.rightCols(6) = two.V.leftCols(6).colwise() + Vector3d(1.0, 0.0, 0.0);
    for (std::size_t f = 0; f < 8; ++f) two.F.push_back({two.F[f][0] + 6, two.F[f][1] + 6, two.F[f][2] + 6});
    EXPECT_THAT(check_closed(two, "liver.obj", 1e-3).error().text, HasSubstr("2 components of 8, 8 triangles"));
    TriangleSurface flipped = octahedron(0.1);
    std::swap(flipped.F[0][0], flipped.F[0][1]);
    EXPECT_THAT(check_closed(flipped, "liver.obj", 1e-3).error().text, HasSubstr("flipped"));
    TriangleSurface inside_out = octahedron(0.1);
    for (auto& f : inside_out.F) std::swap(f[0], f[1]);
    ASSERT_TRUE(check_closed(inside_out, "liver.obj", 1e-3));
    EXPECT_GT(signed_volume(inside_out), 0.0);
    TriangleSurface metres = octahedron(100.0);
    EXPECT_THAT(check_liver(metres, "liver.obj", 1.0).error().text, HasSubstr("wrong --unit?"));
}

TEST(SurfaceReader, FormatsAgree) {
    const test::ScratchFolder scratch;
    ASSERT_TRUE(write_text_file(scratch.path() / "a.obj",
                                "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1/1/1 2 4\nf -2 -1 -3\nf 1 4 3\n"));
    ASSERT_TRUE(write_text_file(
        scratch.path() / "a.ply",
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 2 3 1\n3 0 3 2\n"));
    ASSERT_TRUE(write_text_file(
        scratch.path() / "a.vtk",
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\n"
        "POLYGONS 4 16\n3 0 2 1\n3 0 1 3\n3 2 3 1\n3 0 3 2\n"));
    std::string stl = "solid a\n";
    const auto obj = read_surface(scratch.path() / "a.obj", 1e-3);
    ASSERT_TRUE(obj) << obj.error().text;
    for (std::size_t f = 0; f < 4; ++f) {
        stl += "facet normal 0 0 0\nouter loop\n";
        for (int k = 0; k < 3; ++k) {
            const Vector3d c = 1e3 * obj->corner(f, k);
            stl += "vertex " + std::to_string(c[0]) + " " + std::to_string(c[1]) + " " + std::to_string(c[2]) + "\n";
        }
        stl += "endloop\nendfacet\n";
    }
    ASSERT_TRUE(write_text_file(scratch.path() / "a.stl", stl + "endsolid\n"));
    for (const char* name : {"a.obj", "a.ply", "a.vtk", "a.stl"}) {
        const auto s = read_surface(scratch.path() / name, 1e-3);
        ASSERT_TRUE(s) << s.error().text;
        EXPECT_EQ(s->num_vertices(), 4) << name;
        EXPECT_NEAR(signed_volume(*s), 1e-9 / 6.0, 1e-18) << name;
    }
    ASSERT_TRUE(write_text_file(scratch.path() / "b.obj", "v 0 0 0\nv 1 0 0\nv 0 1 x\n"));
    EXPECT_THAT(read_surface(scratch.path() / "b.obj", 1.0).error().text, HasSubstr("b.obj:3: "));
}

TEST(Registration, BringsTheShapeOntoATurnedAndScaledCopy) {
    const TriangleSurface shape = lopsided();
    Similarity truth;
    truth.R = Eigen::AngleAxisd(0.4, Vector3d(1, 2, -1).normalized()).toRotationMatrix();
    truth.scale = 1.1;
    truth.t = Vector3d(0.3, -0.2, 0.1);
    const TriangleSurface target{truth(shape.V), shape.F};
    const AlignedStart found = align(shape, target, upright_starts());
    EXPECT_LT((found.similarity.R - truth.R).norm(), 0.25);  // closest points slide on a smooth body
    EXPECT_NEAR(found.similarity.scale, 1.1, 0.01);
    const Registration r = register_shape(simplified(shape, 400), target, found.similarity);
    EXPECT_LT(r.rms_m, 0.001);
}

TEST(AttachmentProbability, RegionsHoldWhatTheyState) {
    // f = exp(20 x) along 1000 equal vertices, x in [0, 1]: the integral below x is exp(20 (x - 1)).
    const Eigen::VectorXd f = (20.0 * Eigen::ArrayXd::LinSpaced(1000, 0.0, 1.0)).exp();
    const Eigen::VectorXd area = Eigen::VectorXd::Constant(1000, 2.0);
    const Eigen::VectorXd p = attachment_probability(f, area);
    for (const double level : {0.1, 0.3, 0.5})
        EXPECT_NEAR(p[static_cast<Eigen::Index>(1000.0 * (1.0 + std::log(level) / 20.0))], level, 0.01);
    double outside = 0.0;
    for (Eigen::Index v = 0; v < 1000; ++v) outside += p[v] < 0.1 ? p[v] : 0.0;
    EXPECT_NEAR(outside / p.sum(), 0.1, 0.001);
}

TEST(RotationToRas, KnowsFramesAndRefusesMirroredOnes) {
    const auto lsa = rotation_to_ras("LSA");
    ASSERT_TRUE(lsa);
    EXPECT_EQ(*lsa * Vector3d(1, 2, 3), Vector3d(-1, 3, 2));
    EXPECT_THAT(rotation_to_ras("LAS").error().text, HasSubstr("mirrored"));
    EXPECT_THAT(rotation_to_ras("RRS").error().text, HasSubstr("one letter each"));
}

TEST(AnnotatedLivers, AnnotationsOffTheSurfaceAreNamed) {
    const test::ScratchFolder scratch;
    std::filesystem::create_directories(scratch.path() / "mesh");
    std::filesystem::create_directories(scratch.path() / "landmarks");
    ASSERT_TRUE(write_obj(octahedron(0.1), scratch.path() / "mesh/a.obj", "", 1e-3));
    const auto read = [&](const std::string& rows) {
        EXPECT_TRUE(write_text_file(scratch.path() / "landmarks/a.csv", "class,v0,v1\n" + rows));
        return read_annotated_livers(scratch.path(), 1e-3, "RAS");
    };
    const auto good = read("ligament,0,2\nridge,1,5\n");
    ASSERT_TRUE(good) << good.error().text;
    EXPECT_EQ(good->front().nodes.at("falciform"), (std::vector<std::int32_t>{0, 2}));
    // 0 and 1 are opposite corners
    EXPECT_THAT(read("ligament,0,2\nligament,0,1\n").error().text,
                HasSubstr("a.csv:3: annotation off the surface: 0-1"));
    EXPECT_THAT(read("ligament,0,77\n").error().text, HasSubstr("annotation off the surface: 0-77"));
}

// The shipped atlas on an independent liver it has not seen: turned by 30 degrees and in metres it says the
// same.
TEST(AtlasCommand, PoseAndUnitDoNotMatter) {
    TERES_REQUIRE_DATA(mesh, "livers/atlas15/mesh/LiTS-57.obj");
    const test::ScratchFolder scratch;
    const std::filesystem::path source = std::getenv("TERES_SOURCE_DIR");
    const std::string atlas = (source / "config/atlas").string();
    const auto transfer = [&](const std::string& surface, const char* unit, const std::string& out) {
        return test::run_teres({"atlas", "transfer", atlas, surface, "--unit", unit, "-o", out});
    };
    const auto first = transfer(mesh.string(), "mm", scratch.path() / "a.csv");
    ASSERT_EQ(first.exit_code, 0) << first.error;
    EXPECT_THAT(first.error, HasSubstr("spread is not to be trusted"));
    TriangleSurface s = *read_surface(mesh, 1e-3);
    s.V = Eigen::AngleAxisd(std::numbers::pi / 6.0, Vector3d(1, -1, 1).normalized()).toRotationMatrix() * s.V;
    ASSERT_TRUE(write_obj(s, scratch.path() / "turned.obj", "", 1.0));
    const auto second = transfer(scratch.path() / "turned.obj", "m", scratch.path() / "b.csv");
    ASSERT_EQ(second.exit_code, 0) << second.error;
    const auto values = [](const std::filesystem::path& file) {
        std::ifstream in(file);
        std::string line;
        std::getline(in, line);
        EXPECT_EQ(line, "node_id,probability");
        std::vector<double> p;
        while (std::getline(in, line)) {
            EXPECT_EQ(std::stoul(line), p.size());
            p.push_back(std::stod(line.substr(line.find(',') + 1)));
        }
        return p;
    };
    const auto a = values(scratch.path() / "a.csv"), b = values(scratch.path() / "b.csv");
    ASSERT_EQ(a.size(), static_cast<std::size_t>(s.num_vertices()));
    ASSERT_EQ(a.size(), b.size());
    double difference = 0.0, sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        difference += std::abs(a[i] - b[i]);
        sum += a[i];
    }
    EXPECT_LT(difference, 0.25 * sum);  // the closest-point iteration ends in another place, a few mm away

    s.V = Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitY()).toRotationMatrix() * s.V;
    ASSERT_TRUE(write_obj(s, scratch.path() / "down.obj", "", 1e-3));
    const auto down = transfer(scratch.path() / "down.obj", "mm", scratch.path() / "c.csv");
    EXPECT_EQ(down.exit_code, 2);
    EXPECT_THAT(down.error, HasSubstr("upside down"));
    EXPECT_EQ(transfer(scratch.path() / "down.obj", "m", scratch.path() / "c.csv").exit_code, 2);
}

}  // namespace
}  // namespace teres
