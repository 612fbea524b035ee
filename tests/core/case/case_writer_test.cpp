#include "core/case/case_writer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>

#include "core/case/case_reader.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// A case that uses every table of the format.
Case full_case() {
    Case c = test::clamped_block({.cells = {4, 2, 2}, .law = BodyLaw::kOgden, .full_force_n = {0.0, 1.0 / 3.0, -0.1}});
    c.ligament = LigamentData{LigamentLaw::kCubicSpring, 1e5, 0.48, 0.025, 0.02, 0.001};
    c.gravity_m_s2 = {0.0, 0.1, -9.81};
    c.sensor.camera_position_m = Point{0.0, 0.0, 0.35};
    c.sensor.view_direction = Point{0.0, 0.0, -1.0};
    c.sensor.up = Point{0.0, 1.0, 0.0};
    c.sensor.latency_s = 0.05;
    c.ligament_prior = {{3, 0.25}, {5, 1.0}};
    c.tools = {{"grasper", 7, 100.0}, {"grasper", 8, 120.0}, {"probe", 2, 50.0}};
    for (const double t_s : {0.0, 0.1})
        for (const std::int32_t tool : {0, 1, 2})
            c.tool_samples.push_back({t_s, tool, tool < 2 ? Point{0.1, t_s, 0.0} : Point{kNaN, kNaN, kNaN}});
    c.springs = {{4, {0.0, 0.01, 0.05}, SpringLaw::kPolynomial, {10.0, -2.0, 5e4}, 0.025, "left"},
                 {6, {0.0, 0.01, 0.05}, SpringLaw::kRestShape, {1e6, 0.0, 0.0}, 0.0, "right"}};
    c.mesh.region.assign(c.mesh.tets.size(), 1);
    c.mesh.region.back() = 2;
    c.observations[5].position_m = {kNaN, kNaN, kNaN};
    return c;
}

TEST(CaseWriter, ReadingGivesBackEveryBit) {
    const test::ScratchFolder scratch;
    const Case c = full_case();
    ASSERT_TRUE(write_case(c, scratch.path()));
    const auto read = read_case(scratch.path());
    ASSERT_TRUE(read) << read.error().text;

    EXPECT_EQ(read->name, c.name);
    EXPECT_EQ(read->frame, c.frame);
    EXPECT_EQ(read->num_frames, c.num_frames);
    EXPECT_EQ(read->dt_s, c.dt_s);
    EXPECT_EQ(read->quasi_static, c.quasi_static);
    EXPECT_EQ(read->body.law, BodyLaw::kOgden);
    EXPECT_EQ(read->body.shear_modulus_pa, c.body.shear_modulus_pa);
    EXPECT_EQ(read->body.bulk_modulus_pa, c.body.bulk_modulus_pa);
    EXPECT_EQ(read->body.alpha, c.body.alpha);
    EXPECT_EQ(read->body.youngs_modulus_pa, c.body.youngs_modulus_pa);
    EXPECT_EQ(read->body.density_kg_m3, c.body.density_kg_m3);
    ASSERT_TRUE(read->ligament);
    EXPECT_EQ(read->ligament->law, LigamentLaw::kCubicSpring);
    EXPECT_EQ(read->ligament->height_m, 0.025);
    EXPECT_EQ(read->ligament->thickness_m, 0.001);
    EXPECT_EQ(read->gravity_m_s2, c.gravity_m_s2);
    EXPECT_EQ(read->sensor.noise_sigma_m, c.sensor.noise_sigma_m);
    EXPECT_EQ(read->sensor.camera_position_m, c.sensor.camera_position_m);
    EXPECT_EQ(read->sensor.view_direction, c.sensor.view_direction);
    EXPECT_EQ(read->sensor.up, c.sensor.up);
    EXPECT_EQ(read->sensor.latency_s, c.sensor.latency_s);

    EXPECT_EQ(read->mesh.nodes, c.mesh.nodes);
    EXPECT_EQ(read->mesh.tets, c.mesh.tets);
    EXPECT_EQ(read->mesh.region, c.mesh.region);
    EXPECT_EQ(read->clamped, c.clamped);
    ASSERT_EQ(read->ligament_prior.size(), 2u);
    EXPECT_EQ(read->ligament_prior[0].probability, 0.25);
    ASSERT_EQ(read->load_regions.size(), 1u);
    EXPECT_EQ(read->load_regions[0].name, "tip");
    EXPECT_EQ(read->load_regions[0].node_ids, c.load_regions[0].node_ids);
    EXPECT_EQ(read->load_regions[0].weights, c.load_regions[0].weights);
    ASSERT_EQ(read->loads.size(), c.loads.size());
    for (std::size_t i = 0; i < c.loads.size(); ++i) {
        EXPECT_EQ(read->loads[i].t_s, c.loads[i].t_s);
        EXPECT_EQ(read->loads[i].force_n, c.loads[i].force_n);
    }
    ASSERT_EQ(read->tools.size(), 3u);
    EXPECT_EQ(read->tools[1].node_id, 8);
    EXPECT_EQ(read->tools[1].stiffness_n_per_m, 120.0);
    ASSERT_EQ(read->tool_samples.size(), 6u);  // two ties of the grasper each get its samples
    EXPECT_EQ(read->tool_samples[4].tool, 1);
    EXPECT_EQ(read->tool_samples[4].position_m, (Point{0.1, 0.1, 0.0}));
    EXPECT_TRUE(std::isnan(read->tool_samples[5].position_m[0]));
    ASSERT_EQ(read->springs.size(), 2u);
    EXPECT_EQ(read->springs[0].law, SpringLaw::kPolynomial);
    EXPECT_EQ(read->springs[0].k, c.springs[0].k);
    EXPECT_EQ(read->springs[0].anchor_m, c.springs[0].anchor_m);
    EXPECT_EQ(read->springs[1].group, "right");
    ASSERT_EQ(read->markers.size(), c.markers.size());
    EXPECT_EQ(read->markers[3].position_m, c.markers[3].position_m);
    ASSERT_EQ(read->observations.size(), c.observations.size());
    EXPECT_EQ(read->observations[6].position_m, c.observations[6].position_m);
    EXPECT_TRUE(std::isnan(read->observations[5].position_m[2]));
    ASSERT_EQ(read->validation_rest.size(), c.validation_rest.size());
    EXPECT_EQ(read->validation_rest[1].position_m, c.validation_rest[1].position_m);
}

TEST(CaseWriter, RemovesTablesThatTheCaseLacks) {
    const test::ScratchFolder scratch;
    ASSERT_TRUE(write_case(full_case(), scratch.path()));
    ASSERT_TRUE(std::filesystem::exists(scratch.path() / "springs.csv"));
    ASSERT_TRUE(write_case(test::clamped_block(), scratch.path()));
    EXPECT_FALSE(std::filesystem::exists(scratch.path() / "springs.csv"));
    const auto read = read_case(scratch.path());
    ASSERT_TRUE(read) << read.error().text;
    EXPECT_TRUE(read->tools.empty());
    EXPECT_FALSE(read->ligament);
}

TEST(CaseWriter, UnwritableFolderIsAHostFault) {
    const test::ScratchFolder scratch;
    std::ofstream(scratch.path() / "taken") << "a file, not a folder";
    const auto status = write_case(test::clamped_block(), scratch.path() / "taken");
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().kind, ErrorKind::kHostFault);
    EXPECT_NE(status.error().text.find("taken"), std::string::npos);
}

TEST(CaseWriter, PositionsSurviveTheRoundTrip) {
    const test::ScratchFolder scratch;
    const std::vector<PositionSample> samples{{0.0, 0, {1.0 / 3.0, -2e-17, 0.1}}, {0.2, 0, {kNaN, kNaN, kNaN}}};
    const auto file = scratch.path() / "predict.csv";
    ASSERT_TRUE(write_positions(file, "point_id", samples));
    const auto read = read_positions(file, "point_id");
    ASSERT_TRUE(read) << read.error().text;
    ASSERT_EQ(read->size(), 2u);
    EXPECT_EQ((*read)[0].position_m, samples[0].position_m);
    EXPECT_TRUE(std::isnan((*read)[1].position_m[1]));
}

TEST(BlockMesh, FillsTheBlock) {
    const Point size{0.1, 0.03, 0.02};
    const TetMeshData mesh = test::block_mesh(size, {5, 3, 2});
    EXPECT_EQ(mesh.nodes.size(), 6u * 4u * 3u);
    EXPECT_EQ(mesh.tets.size(), 6u * 5u * 3u * 2u);
    double volume = 0.0;
    for (std::size_t tet = 0; tet < mesh.tets.size(); ++tet) {
        EXPECT_GT(signed_volume_m3(mesh, tet), 0.0) << "tetrahedron " << tet;
        volume += signed_volume_m3(mesh, tet);
    }
    EXPECT_NEAR(volume, size[0] * size[1] * size[2], 1e-15);
    // two triangles a rectangle of the boundary: neighbouring boxes match
    EXPECT_EQ(Surface(mesh).triangles().size(), 2u * 2u * (5u * 3u + 5u * 2u + 3u * 2u));
}

}  // namespace
}  // namespace teres
