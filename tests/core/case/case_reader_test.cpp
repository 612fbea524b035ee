#include "core/case/case_reader.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/case/geometry.h"
#include "core/case/surface.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

TEST(CaseReader, ReadsTheLiverControlCase) {
    TERES_REQUIRE_DATA(folder, "febio/control");
    const auto c = read_case(folder);
    ASSERT_TRUE(c) << c.error().text;
    EXPECT_EQ(c->mesh.nodes.size(), 1977u);
    EXPECT_EQ(c->mesh.tets.size(), 8337u);
    EXPECT_EQ(c->num_frames, 61);
    EXPECT_EQ(c->markers.size(), 14u);
    EXPECT_EQ(c->observations.size(), 61u * 14u);
    EXPECT_EQ(c->validation_rest.size(), 60u);
    EXPECT_EQ(c->ligament_prior.size(), 211u);
    ASSERT_EQ(c->load_regions.size(), 3u);
    EXPECT_EQ(c->load_regions[0].name, "F1");
    // first row of load_nodes.csv: F1,117,0.026625
    EXPECT_EQ(c->load_regions[0].node_ids[0], 117);
    EXPECT_EQ(c->load_regions[0].weights[0], 0.026625);
    EXPECT_EQ(c->observations[1].position_m, (Point{-0.100618, -0.074863, 0.025563}));
    std::size_t lost = 0;
    for (const auto& sample : c->observations) lost += std::isnan(sample.position_m[0]) ? 1u : 0u;
    EXPECT_EQ(lost, 26u);
    // README of the data: 1.4 L
    double volume = 0.0;
    for (std::size_t tet = 0; tet < c->mesh.tets.size(); ++tet) volume += signed_volume_m3(c->mesh, tet);
    EXPECT_NEAR(volume, 1.4e-3, 0.05e-3);
}

TEST(CaseReader, ReadsEveryCaseAtHand) {
    TERES_REQUIRE_DATA(data, "febio");
    std::size_t read = 0;
    for (const auto& root : {data, data / ".." / "beam" / "cases"})
        for (const auto& entry : std::filesystem::directory_iterator(root)) {
            if (!entry.is_directory()) continue;
            const auto c = read_case(entry.path());
            EXPECT_TRUE(c) << c.error().text;
            ++read;
        }
    EXPECT_GE(read, 12u);
}

TEST(CaseReader, ReadsPeerMeshesWithRegions) {
    TERES_REQUIRE_DATA(file, "peer/cylinder_two_moduli/mesh.vtk");
    const auto mesh = read_vtk_tets(file, true);
    ASSERT_TRUE(mesh) << mesh.error().text;
    EXPECT_EQ(mesh->nodes.size(), 126u);
    EXPECT_EQ(mesh->tets.size(), 385u);
    ASSERT_EQ(mesh->region.size(), 385u);
    EXPECT_EQ(mesh->region[0], 1);
}

}  // namespace
}  // namespace teres
