// The bundled demo case holds what its README.md says, and the reader accepts it.
#include <gmock/gmock.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "core/case/case_reader.h"

namespace teres {
namespace {

std::filesystem::path demo_folder() {
    const char* source = std::getenv("TERES_SOURCE_DIR");
    return std::filesystem::path(source != nullptr ? source : ".") / "config/cases/demo";
}

class DemoCase : public ::testing::Test {
  protected:
    void SetUp() override {
        Result<Case> read = read_case(demo_folder());
        ASSERT_TRUE(read) << read.error().text;
        case_ = std::move(*read);
        std::ifstream file(demo_folder() / "truth.json");
        truth_ = nlohmann::json::parse(file);
    }
    Case case_;
    nlohmann::json truth_;
};

TEST_F(DemoCase, IsSmallEnoughToBeBundled) {
    std::uintmax_t bytes = 0;
    for (const auto& entry : std::filesystem::directory_iterator(demo_folder())) bytes += entry.file_size();
    EXPECT_LT(bytes, 1500000u);
    EXPECT_GE(case_.mesh.tets.size(), 4500u);
    EXPECT_LE(case_.mesh.tets.size(), 7000u);
}

TEST_F(DemoCase, HoldsARecordingWithLostMarkers) {
    EXPECT_EQ(case_.num_frames, 41);
    EXPECT_EQ(case_.markers.size(), 14u);
    ASSERT_EQ(case_.observations.size(), 41u * 14u);
    EXPECT_GE(case_.validation_rest.size(), 40u);
    const auto lost = std::count_if(case_.observations.begin(), case_.observations.end(),
                                    [](const PositionSample& s) { return std::isnan(s.position_m[0]); });
    EXPECT_GT(lost, 5);
    EXPECT_LT(lost, 41 * 14 / 10);
}

// Noise of 0.3 mm per axis: the first frame is at rest (no load), so its rms over 42 numbers is 0.3 mm within
// 4 sigma.
TEST_F(DemoCase, FirstFrameIsTheRestShapeWithinNoise) {
    double sum = 0.0;
    int count = 0;
    for (const PositionSample& sample : case_.observations) {
        if (sample.t_s > 0.0 || std::isnan(sample.position_m[0])) continue;
        for (const MarkerRest& marker : case_.markers) {
            if (marker.id != sample.id) continue;
            for (std::size_t i = 0; i < 3; ++i) sum += std::pow(sample.position_m[i] - marker.position_m[i], 2);
            count += 3;
        }
    }
    const double rms = std::sqrt(sum / count);
    EXPECT_NEAR(rms, 3e-4, 4.0 * 3e-4 / std::sqrt(2.0 * count));
}

// The band of the truth lies inside the prior region, and part of the region carries nothing.
TEST_F(DemoCase, TrueBandDiffersFromThePrior) {
    std::set<std::int32_t> expected, true_nodes;
    double missed_probability = 0.0;
    for (const NodeProbability& node : case_.ligament_prior) expected.insert(node.node_id);
    for (const auto& id : truth_["ligament"]["attachment_node_ids"]) true_nodes.insert(id.get<std::int32_t>());
    ASSERT_GT(true_nodes.size(), 10u);
    for (const std::int32_t id : true_nodes) EXPECT_TRUE(expected.count(id)) << "node " << id;
    for (const NodeProbability& node : case_.ligament_prior) {
        if (!true_nodes.count(node.node_id)) missed_probability = std::max(missed_probability, node.probability);
    }
    EXPECT_GT(missed_probability, 0.6);
    EXPECT_NE(truth_["ligament"]["youngs_modulus_pa"].get<double>(), case_.ligament->youngs_modulus_pa);
}

TEST_F(DemoCase, TruthIsInEquilibriumAndConverged) {
    const auto& solver = truth_["solver"];
    EXPECT_EQ(solver["element"], "C3D10");
    EXPECT_LT(solver["reaction_plus_loads_max_n"].get<double>(), 1e-3);  // [N], loads are tenths of a newton
    EXPECT_GE(solver["increments"].get<int>(), 40);
    EXPECT_GT(truth_["motion"]["rms_points_mm"].get<double>(),
              10.0 * truth_["motion"]["noise_rms_3d_mm"].get<double>());
    std::set<double> x_forces;
    for (const LoadSample& load : case_.loads) x_forces.insert(load.force_n[0]);
    EXPECT_EQ(case_.load_regions.size(), 3u);
    EXPECT_GT(x_forces.size(), 100u);  // never constant
}

}  // namespace
}  // namespace teres
