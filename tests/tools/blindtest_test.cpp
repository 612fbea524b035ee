// Blind test: generator, seal.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <numbers>
#include <set>

#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "core/case/geometry.h"
#include "core/case/mesh_checks.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "tests/support/calculix.h"
#include "tests/support/program.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"
#include "tools/blindtest/body_shape.h"
#include "tools/blindtest/case_maker.h"
#include "tools/blindtest/effect_draws.h"
#include "tools/blindtest/lattice_mesher.h"
#include "tools/blindtest/liver_shape.h"
#include "tools/blindtest/scoring.h"

namespace teres::blindtest {
namespace {

namespace fs = std::filesystem;
using test::ScratchFolder;

// Published first outputs of SplitMix64 from seed 1234567.
TEST(Random, IsSplitMix64) {
    Random random(1234567, {});
    EXPECT_EQ(random.bits(), 6457827717110365317ULL);
    EXPECT_EQ(random.bits(), 3203168211198807973ULL);
    EXPECT_EQ(random.bits(), 9817491932198370423ULL);
}

TEST(LatticeMesher, FillsABall) {
    const double radius = 0.05;
    const auto ball = [&](const Point& p) { return norm(p) - radius; };
    const TetMeshData mesh =
        mesh_level_set(ball, {{-0.06, -0.06, -0.06}, {0.06, 0.06, 0.06}, 0.014, {0.0, 0.6, 0.8}, 0.4});
    EXPECT_TRUE(check_body_mesh(mesh, "ball"));
    double volume = 0.0, worst = 1.0;
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
        volume += signed_volume_m3(mesh, t);
        const auto p = [&](std::size_t i) { return mesh.nodes[static_cast<std::size_t>(mesh.tets[t][i])]; };
        worst = std::min(worst, radius_ratio(p(0), p(1), p(2), p(3)));
        EXPECT_GT(signed_volume_m3(mesh, t), 0.0);
    }
    EXPECT_NEAR(volume, 4.0 / 3.0 * std::numbers::pi * std::pow(radius, 3), 0.04 * volume);  // chords of the sphere
    EXPECT_GT(worst, 0.25);
    const Surface surface(mesh);
    for (const std::int32_t id : surface.nodes())
        EXPECT_NEAR(norm(mesh.nodes[static_cast<std::size_t>(id)]), radius, 1e-5);
}

// Inside, beside a face, beyond an edge and beyond a corner of a block the distance is that of pen and paper.
// Fifteen patients' livers (LiTS) hold 0.87 to 2.20 L; drawn ones are not more than a tenth beyond.
TEST(LiverShape, DrawsAdultsLivers) {
    constexpr double kStep = 4e-3;
    std::vector<double> volumes_l;
    for (std::uint64_t draw = 0; draw < 12; ++draw) {
        Random random(7, {draw});
        const LiverShape liver(random);
        EXPECT_LT(liver.level(liver.centre()), -0.01) << "well inside";
        const auto [low, high] = liver.box();
        std::size_t inside = 0;
        for (double x = low[0]; x <= high[0]; x += kStep)
            for (double y = low[1]; y <= high[1]; y += kStep)
                for (double z = low[2]; z <= high[2]; z += kStep) {
                    if (liver.level({x, y, z}) >= 0.0) continue;
                    ++inside;
                    for (const double face :
                         {x - low[0], high[0] - x, y - low[1], high[1] - y, z - low[2], high[2] - z})
                        EXPECT_GT(face, kStep) << "the box holds it";
                }
        volumes_l.push_back(1e3 * static_cast<double>(inside) * kStep * kStep * kStep);
        const Point out{1.0, 0.0, 0.0}, edge = liver.exit(liver.centre(), out), normal = liver.normal(edge);
        EXPECT_NEAR(liver.level(edge), 0.0, 1e-4);
        EXPECT_GT(dot(normal, out), 0.0) << "outward";
    }
    const auto [least, most] = std::minmax_element(volumes_l.begin(), volumes_l.end());
    EXPECT_GT(*least, 0.9 * 0.87);
    EXPECT_LT(*most, 1.1 * 2.20);
    EXPECT_GT(*most, 1.2 * *least) << "patients differ";
}

TEST(MeshShape, IsTheSignedDistance) {
    const MeshShape shape(test::block_mesh({0.04, 0.03, 0.02}, {4, 3, 2}));
    EXPECT_NEAR(shape.level({0.02, 0.015, 0.004}), -0.004, 1e-12);
    EXPECT_NEAR(shape.level({0.02, 0.015, 0.025}), 0.005, 1e-12);
    EXPECT_NEAR(shape.level({0.043, 0.034, 0.011}), 0.005, 1e-12);
    EXPECT_NEAR(shape.level({-0.001, -0.002, -0.002}), 0.003, 1e-12);
    EXPECT_NEAR(norm(minus(shape.normal({0.02, 0.03, 0.012}), {0.0, 1.0, 0.0})), 0.0, 1e-9);
    EXPECT_NEAR(norm(minus(shape.exit({0.02, 0.015, 0.01}, {1.0, 0.0, 0.0}), {0.04, 0.015, 0.01})), 0.0, 1e-9);
    EXPECT_NEAR(shape.scale(), std::cbrt(0.04 * 0.03 * 0.02 / 0.00055), 1e-9);  // an adult's: 0.55 litres
    EXPECT_LT(shape.level(shape.centre()), -0.005);
}

// A cut right through a 2 x 1 x 1 block of cubes parts it: the four nodes of the middle face are doubled.
TEST(TruthMesh, CutThroughPartsTheBody) {
    TruthMesh mesh(test::block_mesh({0.02, 0.01, 0.01}, {2, 1, 1}));
    const std::size_t before = mesh.corners().nodes.size();
    EXPECT_EQ(mesh.cut({0.01, 0.005, 0.005}, {1.0, 0.0, 0.0}, 0.0, 1.0), 2u);
    EXPECT_EQ(mesh.corners().nodes.size(), before + 4);
    EXPECT_FALSE(check_body_mesh(mesh.corners(), "parted"));
}

// A cut that ends inside opens the surface but the body stays in one piece.
TEST(TruthMesh, CutOfAnEdgeStaysConnected) {
    TruthMesh mesh(test::block_mesh({0.02, 0.02, 0.02}, {4, 4, 4}));
    EXPECT_GT(mesh.cut({0.01, 0.0, 0.0}, {1.0, 0.0, 0.0}, 0.0, 0.011), 0u);
    std::set<std::array<std::int32_t, 4>> tets(mesh.corners().tets.begin(), mesh.corners().tets.end());
    EXPECT_EQ(tets.size(), 6u * 64u);
    EXPECT_GT(mesh.corners().nodes.size(), 125u);
}

TEST(Plan, SameSeedSameCasesAndShardsAddUp) {
    PlanOptions options;
    options.seed = 5;
    options.cases = 58;
    options.two_causes = 7;
    const auto whole = plan_cases(options), again = plan_cases(options);
    ASSERT_TRUE(whole && again);
    std::vector<CaseSpec> joined;
    options.shards = 4;
    for (options.shard = 0; options.shard < 4; ++options.shard) {
        const auto part = plan_cases(options);
        ASSERT_TRUE(part);
        joined.insert(joined.end(), part->begin(), part->end());
    }
    ASSERT_EQ(whole->size(), 65u);
    ASSERT_EQ(joined.size(), 65u);
    std::map<std::string, int> count;
    for (std::size_t i = 0; i < 65; ++i) {
        for (const CaseSpec* other : std::array<const CaseSpec*, 2>{&again->at(i), &joined.at(i)}) {
            EXPECT_EQ((*whole)[i].name, other->name);
            EXPECT_EQ((*whole)[i].effects, other->effects);
            EXPECT_EQ((*whole)[i].clamped, other->clamped);
        }
        if (i < 58) ++count[cause_name((*whole)[i].effects)];
        EXPECT_EQ((*whole)[i].effects.size() == 2u, i >= 58);
    }
    EXPECT_EQ(count.size(), 27u);
    EXPECT_EQ(count["none"], 6);
    EXPECT_EQ(count["cut"], 2);
}

TEST(Plan, RejectsNonsense) {
    PlanOptions none, beyond, ghost;
    none.cases = 0;
    beyond.shard = beyond.shards = 4;
    ghost.effects = {"ghost"};
    EXPECT_FALSE(plan_cases(none));
    EXPECT_FALSE(plan_cases(beyond));
    const auto unknown = plan_cases(ghost);
    ASSERT_FALSE(unknown);
    EXPECT_THAT(unknown.error().text, ::testing::HasSubstr("'ghost'"));
}

// Causes that a given body has no part for are left out; all cases are of the one patient.
TEST(Plan, OfAGivenBodyHoldsWhatItCanShow) {
    PlanOptions options;
    options.cases = 40;
    options.two_causes = 10;
    options.given = PlanOptions::Given{.clamped = false, .dynamic = false, .ligament = true};
    const auto cases = plan_cases(options);
    ASSERT_TRUE(cases);
    std::set<std::string> seen;
    for (const CaseSpec& spec : *cases) {
        EXPECT_EQ(spec.draw, 0u);
        EXPECT_FALSE(spec.clamped || spec.dynamic);
        seen.insert(spec.effects.begin(), spec.effects.end());
    }
    for (const char* id : {"clamp_compliance", "ligament_slack", "inertia", "damping"})
        EXPECT_EQ(seen.count(id), 0u) << id;
    EXPECT_EQ(seen.size(), 22u);
    options.given->ligament = false;
    const auto planned = plan_cases(options);
    ASSERT_TRUE(planned) << planned.error().text;
    for (const CaseSpec& spec : *planned)
        for (const std::string& id : spec.effects)
            EXPECT_THAT(id, ::testing::AnyOf("none", ::testing::Not("ligament_tear")));
    options.effects = {"inertia"};
    EXPECT_FALSE(plan_cases(options));
}

TEST(Seal, IsSha256) {  // FIPS 180-2, appendix B.1
    EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

// The nominal model's clamp: as much as the truth's and where it is, or a body that little else holds swings on it
// otherwise. Of the fourth patch the three nearest nodes lie as far out as the whole of it does.
TEST(TruthBody, ClampOfTheCaseHoldsAsMuch) {
    TERES_REQUIRE_CALCULIX();
    for (const std::uint64_t seed : {3U, 7U, 11U, 20261402U}) {
        const ScratchFolder scratch;
        const auto body = TruthBody::make({.seed = seed, .clamped = true}, scratch.path());
        ASSERT_TRUE(body) << body.error().text;
        double patch_m2 = 0.0, own_m2 = 0.0, held_m2 = 0.0;
        std::set<std::int32_t> truth;
        for (const std::int32_t t : body->mesh().find(body->clamp())) {
            patch_m2 += body->mesh().area(static_cast<std::size_t>(t));
            for (const std::int32_t node : body->mesh().face_nodes(static_cast<std::size_t>(t))) truth.insert(node);
        }
        const Case& nominal = body->nominal();
        const auto at = [&](std::int32_t n) { return nominal.mesh.nodes[static_cast<std::size_t>(n)]; };
        const Surface surface(nominal.mesh);
        for (const auto& [a, b, c] : surface.triangles()) {
            const double area_m2 = 0.5 * norm(cross(minus(at(b), at(a)), minus(at(c), at(a))));
            const auto& clamped = nominal.clamped;
            const auto held = std::count(clamped.begin(), clamped.end(), a) +
                              std::count(clamped.begin(), clamped.end(), b) +
                              std::count(clamped.begin(), clamped.end(), c);
            own_m2 += area_m2 * static_cast<double>(held) / 3.0;
            held_m2 += held == 3 ? area_m2 : 0.0;
        }
        EXPECT_NEAR(own_m2 / patch_m2, 1.5, 0.1) << "seed " << seed;
        EXPECT_NEAR(held_m2 / patch_m2, 0.8, 0.15) << "seed " << seed << ": triangles whose nodes are all held";
        for (const std::int32_t n : nominal.clamped) {  // half an edge of its mesh (12 mm) beyond the patch at most
            double away = 1.0;
            for (const std::int32_t t : truth)
                away = std::min(away, distance(at(n), body->mesh().nodes()[static_cast<std::size_t>(t)]));
            EXPECT_LT(away, 0.012) << "seed " << seed;
        }
    }
}

// A contact that pushes at rest is a steady force, whatever its label says.
TEST(MechanicalEffects, AContactPushesOnlyWhatRunsIntoIt) {
    TERES_REQUIRE_CALCULIX();
    const ScratchFolder scratch;
    const auto body = TruthBody::make({.seed = 3}, scratch.path());
    ASSERT_TRUE(body) << body.error().text;
    Random random(5, {});
    int drawn = 0;
    for (int draw = 0; draw < 5; ++draw) {
        Scenario scenario = body->control();
        const std::size_t beds = scenario.beds.size();
        const auto truth = draw_mechanics("contact", random, *body, scenario, scratch.path());
        if (!truth) continue;  // no facet there
        ASSERT_EQ(scenario.beds.size(), beds + 1);
        const auto& law = scenario.beds.back().elongation_stress;
        const auto stress_pa = [&](double elongation_m) {
            const auto after =
                std::find_if(law.begin(), law.end(), [&](const auto& p) { return p.first > elongation_m; });
            const auto [x1, s1] = *after;
            const auto [x0, s0] = *std::prev(after);
            return std::lerp(s0, s1, (elongation_m - x0) / (x1 - x0));
        };
        const double gap = truth->parameters.at("gap_m");
        EXPECT_LT(std::abs(stress_pa(0.0)), 50.0);
        EXPECT_NEAR(stress_pa(-gap - 0.003), -3e6 * 0.003, 100.0);  // as far in as loads push a surface
        EXPECT_EQ(std::lround(stress_pa(0.01)), 0);
        ++drawn;
    }
    EXPECT_GE(drawn, 3);
}

// By hand: d = (3, 4) in two frames, explained direction (1, 1): the rest is (-0.5, 0.5).
TEST(Gap, LeavesOutWhatTheLigamentExplains) {
    const auto one_marker = [](double a, double b) { return Frames{{{a, 0.0, 0.0}}, {{b, 0.0, 0.0}}}; };
    const Frames d = one_marker(3.0, 4.0);
    EXPECT_NEAR(unexplained_rms(d, {}), std::sqrt(12.5), 1e-12);
    EXPECT_NEAR(unexplained_rms(d, {one_marker(1.0, 1.0)}), 0.5, 1e-12);
    EXPECT_NEAR(unexplained_rms(d, {one_marker(1.0, 1.0), one_marker(2.0, 2.0)}), 0.5, 1e-12);  // the same twice
    EXPECT_NEAR(unexplained_rms(d, {one_marker(1.0, 1.0), one_marker(1.0, 0.0)}), 0.0, 1e-12);
}

// By hand, three frames and one ligament direction (0, 0, 1): of (3, 4, 2) beside another effect of (2, 0, 0) 4 is
// left; alone it would be (0, 1, 5), which shows 1.
TEST(Gap, OfOneEffectIsWhatTheOthersCannotMakeUpFor) {
    const auto one_marker = [](double a, double b, double c) {
        return Frames{{{a, 0.0, 0.0}}, {{b, 0.0, 0.0}}, {{c, 0.0, 0.0}}};
    };
    const std::vector<Frames> ligament{one_marker(0.0, 0.0, 1.0)};
    const Frames other = one_marker(2.0, 0.0, 0.0), added = one_marker(3.0, 4.0, 2.0),
                 without = one_marker(0.0, 1.0, 5.0);
    EXPECT_NEAR(shown_rms(0, {added}, {added}, ligament), 5.0 / std::sqrt(3.0), 1e-12);
    EXPECT_NEAR(shown_rms(1, {other, added}, {other, added}, ligament), 4.0 / std::sqrt(3.0), 1e-12);
    EXPECT_NEAR(shown_rms(1, {other, added}, {other, without}, ligament), 1.0 / std::sqrt(3.0), 1e-12);
    EXPECT_NEAR(shown_rms(0, {other, added}, {other, without}, ligament), 2.0 * 0.8 / std::sqrt(3.0), 1e-12);
}

SensorState linear_motion(const Case& c) {  // every marker moves at 1 mm per frame along x
    SensorState state;
    for (int k = 0; k < 12; ++k) {
        state.seen.emplace_back();
        for (const MarkerRest& m : c.markers) state.seen.back().push_back(plus(m.position_m, {0.001 * k, 0.0, 0.0}));
    }
    return state;
}

Case camera_case() {
    Case c = test::clamped_block();
    c.sensor.camera_position_m = Point{0.05, 0.0, 0.4};
    c.sensor.view_direction = Point{0.0, 0.0, -1.0};
    return c;
}

TEST(SensorEffects, AreWhatTheySay) {
    const Case c = camera_case();
    const SensorState before = linear_motion(c);
    Random random(3, {});
    {
        SensorState s = before;  // a rigid motion keeps distances
        draw_sensor("registration", random, c, s);
        EXPECT_NEAR(distance(s.seen[4][0], s.seen[9][5]), distance(before.seen[4][0], before.seen[9][5]), 1e-12);
        EXPECT_GT(distance(s.seen[4][0], before.seen[4][0]), 5e-4);
    }
    {
        SensorState s = before;  // a steady motion lags by velocity x latency
        const EffectTruth truth = draw_sensor("latency", random, c, s);
        EXPECT_NEAR(before.seen[8][2][0] - s.seen[8][2][0],
                    0.001 / c.dt_s * truth.parameters["latency_s"].get<double>(), 1e-9);
    }
    {
        SensorState s = before;  // markers stay on their rays
        draw_sensor("depth_scale", random, c, s);
        const Point a = minus(s.seen[3][1], *c.sensor.camera_position_m),
                    b = minus(before.seen[3][1], *c.sensor.camera_position_m);
        EXPECT_LT(norm(cross(a, b)), 1e-12);
        EXPECT_GT(std::abs(norm(a) - norm(b)), 5e-4);
    }
    {
        SensorState s = before;  // only the named markers, only from the onset
        const EffectTruth truth = draw_sensor("marker_slip", random, c, s);
        for (std::size_t k = 0; k < s.seen.size(); ++k)
            for (std::size_t m = 0; m < c.markers.size(); ++m) {
                const bool named = std::count(truth.markers.begin(), truth.markers.end(), c.markers[m].id) != 0;
                if (!named || static_cast<double>(k) * c.dt_s < *truth.onset_s - 1e-9) {
                    EXPECT_EQ(s.seen[k][m], before.seen[k][m]);
                }
            }
    }
}

// Small patients: one control and one sensor case, made twice.
class SmallCases : public ::testing::Test {
  protected:
    static CaseMaker small_maker(const fs::path& out) {
        CaseMaker maker(11, out, out / "scratch");
        maker.body_options.truth_tets = 120;
        maker.body_options.case_tets = 200;
        maker.body_options.frames = 4;
        maker.body_options.markers = 6;
        maker.body_options.points = 5;
        return maker;
    }

    static void make(const fs::path& out, const std::vector<std::string>& effects) {
        PlanOptions plan;
        plan.seed = 11;
        plan.cases = static_cast<int>(effects.size());
        plan.effects = effects;
        const auto cases = plan_cases(plan);
        ASSERT_TRUE(cases);
        CaseMaker maker = small_maker(out);
        for (const CaseSpec& spec : *cases) {
            const auto outcome = maker.make(spec);
            ASSERT_TRUE(outcome) << outcome.error().text;
            EXPECT_EQ(*outcome, CaseMaker::Outcome::kMade);
        }
        const auto again = maker.make(cases->front());
        ASSERT_TRUE(again);
        EXPECT_EQ(*again, CaseMaker::Outcome::kWasThere);
        const auto list = seal_list(out, *cases);
        ASSERT_TRUE(list);
        ASSERT_TRUE(write_text_file(out / "seal-0-of-1.sha256", *list));
    }
};

// What is left of a diagnosis that ended without an answer.
void failed_diagnosis(const fs::path& out, const std::string& name) {
    fs::create_directories(out / "answers");
    std::ofstream(out / "answers" / (name + ".cost.json")) << R"({"exit_code": 2, "seconds": 1.0, "peak_mb": 10.0})";
}

// A block with a ligament on its lid, two loads, a camera.
Case given_block() {
    Case c = camera_case();
    c.clamped.clear();
    c.ligament = LigamentData{.youngs_modulus_pa = 60e3, .poissons_ratio = 0.49, .height_m = 0.02};
    for (std::size_t i = 0; i < c.mesh.nodes.size(); ++i)
        if (const Point& p = c.mesh.nodes[i]; p[2] > 0.0299)
            c.ligament_prior.push_back({static_cast<std::int32_t>(i), p[0] < 0.04 ? 0.9 : 0.05});
    return c;
}

TEST(CheckGiven, NamesWhatCannotBeUsed) {
    EXPECT_TRUE(check_given(given_block()));
    const auto refused = [](const char* why, const auto& spoil) {
        Case c = given_block();
        spoil(c);
        const Status status = check_given(c);
        ASSERT_FALSE(status) << why;
        EXPECT_THAT(status.error().text, ::testing::HasSubstr(why));
    };
    refused("gravity_m_s2", [](Case& c) { c.gravity_m_s2 = {0.0, 0.0, -9.81}; });
    refused("latency_s", [](Case& c) { c.sensor.latency_s = 0.1; });
    refused("camera_position_m", [](Case& c) { c.sensor.camera_position_m.reset(); });
    refused("loads.csv", [](Case& c) { c.loads.clear(); });
    refused("ligament", [](Case& c) { c.ligament_prior.clear(); });
}

// The modeller's side of a case on a given body is the given case; true ligament and sensor are drawn.
TEST(GivenBody, IsKeptByItsCases) {
    TERES_REQUIRE_CALCULIX();
    const ScratchFolder scratch;
    const Case given = given_block();
    ASSERT_TRUE(write_case(given, scratch.path() / "given"));
    const std::vector<std::string> options{
        "--body", (scratch.path() / "given").string(), "--cases", "1", "--effects", "latency", "--seed", "4",
        "--out",  (scratch.path() / "bench").string()};
    std::vector<std::string> generate{"blindtest", "generate"};
    generate.insert(generate.end(), options.begin(), options.end());
    const test::Run made = test::run_teres(generate);
    ASSERT_EQ(made.exit_code, 0) << made.error;
    const auto c = read_case(scratch.path() / "bench/cases/c0000");
    ASSERT_TRUE(c) << c.error().text;
    EXPECT_EQ(c->mesh.tets, given.mesh.tets);
    EXPECT_EQ(c->num_frames, given.num_frames);
    ASSERT_EQ(c->markers.size(), given.markers.size());
    EXPECT_EQ(c->loads.size(), given.loads.size());
    EXPECT_EQ(c->ligament_prior.size(), given.ligament_prior.size());
    ASSERT_TRUE(fs::exists(scratch.path() / "bench/sealed/c0000/label.json"));
    const auto label = nlohmann::json::parse(*read_text_file(scratch.path() / "bench/sealed/c0000/label.json"));
    ASSERT_FALSE(label.value("discarded", false)) << label.dump(1);
    const double modulus_pa = label["ligament"]["youngs_modulus_pa"];
    EXPECT_GT(modulus_pa, 0.6 * 60e3);
    EXPECT_LT(modulus_pa, 1.6 * 60e3);
    for (const auto& facet : label["ligament"]["facet_centroids_m"]) {  // the lid's left part, shifted 4 mm at most
        EXPECT_LT(facet[0], 0.06);
        EXPECT_GT(facet[2], 0.02);
    }
    EXPECT_GT(label["motion_rms_mm"], 0.1);
    generate[3] = (scratch.path() / "nowhere").string();
    const test::Run refused = test::run_teres(generate);
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_THAT(refused.error, ::testing::HasSubstr("nowhere"));
}

TEST_F(SmallCases, AreTheSameForTheSameSeedAndSealed) {
    TERES_REQUIRE_CALCULIX();
    const ScratchFolder one, two;
    const std::vector<std::string> effects{"latency", "load_scale"};
    make(one.path(), effects);
    make(two.path(), effects);
    EXPECT_EQ(*read_text_file(one.path() / "seal-0-of-1.sha256"), *read_text_file(two.path() / "seal-0-of-1.sha256"));
    for (const char* name : {"c0000", "c0001"}) {
        const auto c = read_case(one.path() / "cases" / name);
        ASSERT_TRUE(c) << c.error().text;
        EXPECT_FALSE(fs::exists(one.path() / "cases" / name / "validation.csv"));
        EXPECT_FALSE(fs::exists(one.path() / "cases" / name / "truth.json"));
        for (const char* file : {"observations.csv", "mesh.vtk", "loads.csv"})
            EXPECT_EQ(*read_text_file(one.path() / "cases" / name / file),
                      *read_text_file(two.path() / "cases" / name / file));
    }
    const std::vector<std::string> score{
        "blindtest",          "score", "--seed",           "11", "--cases", "2", "--effects",
        "latency,load_scale", "--out", one.path().string()};
    const test::Run sealed = test::run_teres(score);
    EXPECT_EQ(sealed.exit_code, 0) << sealed.error;
    EXPECT_THAT(sealed.output, ::testing::HasSubstr("holds"));
    EXPECT_THAT(sealed.output, ::testing::HasSubstr("2 cases are not diagnosed yet"));
    EXPECT_THAT(sealed.output, ::testing::HasSubstr("| diagnosis failed | 0 |"));
    for (const char* name : {"c0000", "c0001"}) failed_diagnosis(one.path(), name);
    EXPECT_THAT(test::run_teres(score).output, ::testing::HasSubstr("| diagnosis failed | 2 |"));
    EXPECT_THAT(*read_text_file(one.path() / "results-0-of-1.jsonl"),
                ::testing::HasSubstr("\"body\":\"11/0 "));  // so that results of several seeds merge
    // Judged again, an answer needs its evidence.
    std::ofstream(one.path() / "answers/c0000.json") << R"({"format": "teres-gap-1", "causes": []})";
    std::vector<std::string> again = score;
    again.emplace_back("--again");
    const test::Run refused = test::run_teres(again);
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_THAT(refused.error, ::testing::HasSubstr("c0000.json: not the evidence of a diagnosis"));
    // A set that was stopped after its first case.
    const std::string seal = *read_text_file(one.path() / "seal-0-of-1.sha256");
    std::ofstream(one.path() / "seal-0-of-1.sha256")
        << seal.substr(0, seal.find('\n', seal.find("c0000/validation")) + 1);
    const test::Run part = test::run_teres(score);
    EXPECT_EQ(part.exit_code, 0) << part.error;
    EXPECT_THAT(part.output, ::testing::HasSubstr("1 of 2 cases were not made"));
    EXPECT_THAT(part.output, ::testing::HasSubstr("| diagnosis failed | 1 |"));
    std::ofstream(one.path() / "seal-0-of-1.sha256") << seal;
    std::ofstream(one.path() / "sealed/c0001/label.json", std::ios::app) << " ";
    const test::Run broken = test::run_teres(score);
    EXPECT_EQ(broken.exit_code, 1);
    EXPECT_THAT(broken.error, ::testing::HasSubstr("not those that were sealed"));
}

TEST_F(SmallCases, AreDrawnAgainUntilTheyShow) {
    TERES_REQUIRE_CALCULIX();
    const ScratchFolder out;
    CaseMaker maker = small_maker(out.path());
    const auto made = [&](const char* name, double least_gap_m) {
        maker.least_gap_m = least_gap_m;
        const auto outcome = maker.make({name, 0, {"depth_scale"}});
        EXPECT_TRUE(outcome) << outcome.error().text;
        return *outcome;
    };
    const auto label = [&](const char* name) {
        return nlohmann::json::parse(*read_text_file(out.path() / "sealed" / name / "label.json"));
    };
    ASSERT_EQ(made("c0000", 0.0), CaseMaker::Outcome::kMade);
    const double shown_mm = label("c0000")["effects"][0]["gap_mm"];
    ASSERT_EQ(made("c0001", 1.2e-3 * shown_mm), CaseMaker::Outcome::kMade);
    EXPECT_GE(label("c0001")["effects"][0]["gap_mm"], 1.2 * shown_mm);
    ASSERT_EQ(made("c0002", 10.0), CaseMaker::Outcome::kDiscarded);
    EXPECT_TRUE(label("c0002")["discarded"]);
    EXPECT_THAT(label("c0002")["reason"].get<std::string>(), ::testing::HasSubstr("depth_scale shows"));
    EXPECT_FALSE(fs::exists(out.path() / "cases/c0002"));
    // What bodies are simulated for is given up after a few frames.
    maker.least_gap_m = 10.0;
    ASSERT_EQ(*maker.make({"c0003", 0, {"stiffness"}}), CaseMaker::Outcome::kDiscarded);
    EXPECT_THAT(label("c0003")["reason"].get<std::string>(), ::testing::HasSubstr("at a few frames"));
}

TEST_F(SmallCases, FewFramesOfABodyAreThoseOfAll) {
    TERES_REQUIRE_CALCULIX();
    const ScratchFolder scratch;
    BodyOptions options = small_maker(scratch.path()).body_options;
    options.seed = 11;
    options.frames = 6;
    const auto body = TruthBody::make(options, scratch.path());
    ASSERT_TRUE(body) << body.error().text;
    Scenario torn = body->control(), pressed = body->control();
    torn.event_frame = 3;
    torn.band_after.assign(torn.band.begin(), torn.band.end() - 1);
    ASSERT_GT(torn.band.size(), 2u);
    pressed.gravity_direction = {0.0, 0.0, -1.0};
    pressed.gravity_m_s2.assign(6, 2.0);
    const std::vector<std::size_t> few{1, 4, 5};
    const auto control = body->simulate(body->control(), scratch.path(), nullptr);
    ASSERT_TRUE(control) << control.error().text;
    for (const Scenario& scenario : {body->control(), torn, pressed}) {
        const auto all = body->simulate(scenario, scratch.path(), nullptr);
        const auto some = body->simulate_at(scenario, few, scratch.path(), &*control);
        ASSERT_TRUE(all && some);
        ASSERT_EQ(some->markers.size(), few.size());
        for (std::size_t k = 0; k < few.size(); ++k)
            for (std::size_t m = 0; m < 6; ++m)
                EXPECT_LT(distance(some->markers[k][m], all->markers[few[k]][m]), 2e-5);  // of some mm
    }
}

}  // namespace
}  // namespace teres::blindtest
