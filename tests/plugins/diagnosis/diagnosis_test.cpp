// The whole inference on a body whose motion is known in closed form; the data come from a body that is 2 % softer than
// the nominal one (model error that must not be blamed on anything), with supports other than the prior's.
#include "plugins/diagnosis/diagnosis.h"

#include <gtest/gtest.h>

#include <ctime>
#include <nlohmann/json.hpp>
#include <random>

#include "plugins/diagnosis/gap_json.h"
#include "plugins/diagnosis/judged_again.h"
#include "plugins/diagnosis/share_work.h"
#include "plugins/diagnosis/work_limit.h"
#include "tests/support/test_data.h"
#include "tests/support/toy_body.h"

namespace teres {
namespace {

constexpr double kNoise = 3e-4;

struct Scene {
    test::ToyBody body;
    test::ToyCamera camera;
    std::vector<double> observed;

    // Effects: index in the toy's own catalogues.
    explicit Scene(std::vector<EffectInstance> mechanical, std::vector<EffectInstance> sensor = {},
                   double noise = kNoise, unsigned seed = 1) {
        const std::vector<double> theta{38.0, 70.0};
        const auto truth = body.motion({theta, mechanical}, 1.02);
        observed.resize(truth.size());
        std::vector<double> times;
        for (std::size_t f = 0; f < test::kToyFrames; ++f) times.push_back(body.time_s(f));
        camera.observe(sensor, times, truth, observed);
        std::mt19937 generator(seed);
        std::normal_distribution<double> scatter(0.0, noise);
        for (double& y : observed) y += scatter(generator);
        for (std::size_t f = 20; f < 30; ++f)  // marker 5 is lost for a while
            for (std::size_t a = 0; a < 3; ++a) observed[3 * (f * test::kToyMarkers + 5) + a] = NAN;
    }
    GapRecording recording() { return {"toy", &body, &camera, observed, kNoise, 1}; }
    Result<Diagnosis> run(std::vector<const char*> excluded = {}, int max_effects = 3, double work_limit_s = 0.0) {
        DiagnosisOptions options;
        options.excluded = excluded;
        options.max_effects = max_effects;
        options.work_limit_s = work_limit_s;
        const GapRecording one = recording();
        effects.emplace(body, &camera, options.excluded);
        return diagnose({&one, 1}, *effects, options);
    }
    std::optional<EffectTable> effects;
    std::vector<std::string> names(const Diagnosis& d) {
        std::vector<std::string> list;
        if (const Cause* c = d.named())
            for (const std::size_t e : c->entries) list.emplace_back((*effects)[e].info.id);
        std::sort(list.begin(), list.end());
        return list;
    }
};

std::string listing(const Diagnosis& d, const EffectTable& effects) {
    std::string text = "none " + std::to_string(d.verdict.none_probability) + ", unknown " +
                       std::to_string(d.verdict.unknown_probability) + ", nominal cost " +
                       std::to_string(d.nominal.cost / static_cast<double>(d.recording.fit_rows.size()));
    for (const Cause& c : d.verdict.causes) {
        text += "\n ";
        for (const std::size_t e : c.entries) text += std::string(" ") + effects[e].info.id;
        text += ": score " + std::to_string(c.score) + ", p " + std::to_string(c.probability) + ", cost " +
                std::to_string(c.fit.cost / static_cast<double>(d.recording.fit_rows.size())) + ", search " +
                std::to_string(c.search_cost) + ", values";
        if (c.fit.usable)
            for (const auto& e : c.fit.at.effects)
                for (const double v : e.values) text += " " + std::to_string(v);
    }
    return text;
}

using Names = std::vector<std::string>;

TEST(Diagnosis, ControlIsAnsweredNone) {
    for (const unsigned seed : {1u, 2u, 3u}) {
        Scene scene({}, {}, kNoise, seed);
        const auto d = scene.run();
        ASSERT_TRUE(d) << d.error().text;
        EXPECT_GT(d->verdict.none_probability, 0.5) << seed;
        EXPECT_FALSE(d->significant);
    }
}

// A clamped beam, released: no nominal parameter, beginnings first.
TEST(Diagnosis, DynamicBodyWithoutNominalParameters) {
    const std::vector<double> v{1.6};
    Scene scene({{test::ToyBody::kStiffness, v}});
    scene.body.known_supports = scene.body.inertia = true;
    const auto d = scene.run();
    ASSERT_TRUE(d) << d.error().text;
    ASSERT_EQ(scene.names(*d), Names{"stiffness"}) << listing(*d, *scene.effects);
    EXPECT_NEAR(d->named()->fit.at.effects[0].values[0], 1.6, 0.16) << "the data move 2 % more than the model";
    EXPECT_TRUE(d->nominal.at.theta.empty());
}

// A body six times as stiff as the nominal one, whose variants stray where it swings far: nothing is known of what they
// would say of the real one until they are asked where that was seen.
TEST(Diagnosis, ModelErrorIsThatOfAStateThatWasSeen) {
    const std::vector<double> v{6.0};
    Scene scene({{test::ToyBody::kStiffness, v}});
    scene.body.known_supports = scene.body.inertia = true;
    scene.body.strays_beyond_m = 0.0125;
    const auto d = scene.run();
    ASSERT_TRUE(d) << d.error().text;

    ASSERT_EQ(scene.names(*d), Names{"stiffness"}) << listing(*d, *scene.effects);
    EXPECT_LT(d->floor_m, 0.5 * d->gap_m);
}

// Nothing is missing, so that the model's error is all that is left and no effect comes nearer: the search that asked
// for such a state leaves off on a part of the recording, and the one after it begins from the nominal motion all the
// same.
TEST(Diagnosis, ControlWithInertiaIsAnsweredNone) {
    Scene scene({});
    scene.body.known_supports = scene.body.inertia = true;
    const auto d = scene.run();
    ASSERT_TRUE(d) << d.error().text;
    EXPECT_EQ(d->named(), nullptr) << listing(*d, *scene.effects);
    EXPECT_GT(d->verdict.none_probability, 0.5) << listing(*d, *scene.effects);
}

TEST(Diagnosis, ForceLikeCauseIsNamedPlacedAndTimed) {
    const std::vector<double> v{0.15, -0.1, -0.35, 0.08, 0.03, 5.3};
    Scene scene({{test::ToyBody::kUnknownLoad, v}});
    const auto d = scene.run();
    ASSERT_TRUE(d) << d.error().text;
    ASSERT_EQ(scene.names(*d), Names{"unknown_load"}) << listing(*d, *scene.effects);
    EXPECT_GT(d->named()->probability, 0.8);
    const auto& fitted = d->named()->fit.at.effects[0].values;
    EXPECT_NEAR(fitted[3], 0.08, 0.01);
    EXPECT_NEAR(fitted[4], 0.03, 0.01);
    ASSERT_TRUE(d->where.onset_s);
    EXPECT_NEAR(*d->where.onset_s, 5.3, 0.25) << "one frame is 0.2 s";
    EXPECT_EQ(d->where.kind, "load");
    EXPECT_GT(d->shrinkage.fraction, 0.8);
    EXPECT_LE(d->shrinkage.ci95[0], d->shrinkage.fraction);
    EXPECT_GE(d->shrinkage.ci95[1], d->shrinkage.fraction);
}

// Two effects, of which the time allows for one: an answer is given all the same, and says so.
TEST(Diagnosis, SearchEndsWhenTheTimeIsUsedUp) {
    const std::vector<double> v{0.15, -0.1, -0.35, 0.08, 0.03, 5.3}, shift{0.004, -0.003, 0.005};
    Scene scene({{test::ToyBody::kUnknownLoad, v}}, {{test::ToyCamera::kRegistration, shift}});
    const auto whole = scene.run(), cut = scene.run({}, 3, 1e-6);
    ASSERT_TRUE(whole && cut);
    EXPECT_FALSE(whole->cut_short);
    EXPECT_EQ(scene.names(*whole), (Names{"registration", "unknown_load"})) << listing(*whole, *scene.effects);
    EXPECT_TRUE(cut->cut_short);
    const auto fitted = [](const Diagnosis& d) {
        return std::count_if(d.verdict.causes.begin(), d.verdict.causes.end(),
                             [](const Cause& c) { return c.fit.usable; });
    };
    EXPECT_EQ(fitted(*cut), 2) << listing(*cut, *scene.effects);
    EXPECT_GE(fitted(*whole), 4);
    for (const Cause& cause : cut->verdict.causes) EXPECT_EQ(cause.entries.size(), 1u);
    EXPECT_TRUE(cut->significant) << "one effect alone leaves so much that it is `unknown`, not `none`";
}

// By first order the force is best placed where no fit leads away from; a tilt is better than what is left there.
TEST(Diagnosis, PlacedRivalIsFittedFromOtherPlaces) {
    const std::vector<double> v{0.3, -0.3, 0.9, 0.095, 0.08, 0.5};
    Scene scene({{test::ToyBody::kUnknownLoad, v}});
    scene.body.pulled_at = {v[3], v[4]};
    scene.body.gives_way_n = 0.25;  // the true one is elsewhere and holds
    const auto d = scene.run({}, 1);
    ASSERT_TRUE(d) << d.error().text;
    ASSERT_EQ(scene.names(*d), Names{"unknown_load"}) << listing(*d, *scene.effects);
    const auto& fitted = d->named()->fit.at.effects[0].values;
    EXPECT_NEAR(fitted[3], v[3], 0.01);
    EXPECT_NEAR(fitted[4], v[4], 0.01);
}

// The same where nothing else explains anything: from there the fit costs more than it explains, and linear scores of
// what was not fitted are higher.
TEST(Diagnosis, FitThatDoesNotPayIsTriedFromOtherPlacesBeforeItIsGivenUp) {
    const std::vector<double> v{0.3, -0.3, 0.9, 0.095, 0.08, 0.5};
    Scene scene({{test::ToyBody::kUnknownLoad, v}});
    scene.body.pulled_at = {v[3], v[4]};
    scene.body.gives_way_n = 0.1;
    const auto d = scene.run({"gravity", "registration", "marker_slip"}, 1);
    ASSERT_TRUE(d) << d.error().text;
    ASSERT_EQ(scene.names(*d), Names{"unknown_load"}) << listing(*d, *scene.effects);
    EXPECT_NEAR(d->named()->fit.at.effects[0].values[3], v[3], 0.01);
}

TEST(Diagnosis, StiffnessSensorAndNoiseAreTold) {
    const std::vector<double> soft{0.4}, shift{0.004, -0.003, 0.005}, slip{0.004, 0.0, -0.005, 7.0, 4.1}, law{1500.0};
    {
        Scene scene({{test::ToyBody::kStiffness, soft}});
        const auto d = scene.run();
        ASSERT_TRUE(d);
        EXPECT_EQ(scene.names(*d), Names{"stiffness"}) << listing(*d, *scene.effects);
        EXPECT_NEAR(d->named()->fit.at.effects[0].values[0], 0.4, 0.04);
    }
    {
        Scene scene({}, {{test::ToyCamera::kRegistration, shift}});
        const auto d = scene.run();
        ASSERT_TRUE(d);
        EXPECT_EQ(scene.names(*d), Names{"registration"}) << listing(*d, *scene.effects);
        EXPECT_EQ(d->where.kind, "sensor");
    }
    {
        Scene scene({}, {{test::ToyCamera::kMarkerSlip, slip}});
        const auto d = scene.run();
        ASSERT_TRUE(d);
        EXPECT_EQ(scene.names(*d), Names{"marker_slip"}) << listing(*d, *scene.effects);
        EXPECT_EQ(std::max_element(d->where.marker_share.begin(), d->where.marker_share.end()) -
                      d->where.marker_share.begin(),
                  7);
    }
    {
        Scene scene({}, {}, 4.0 * kNoise);
        const auto d = scene.run();
        ASSERT_TRUE(d);
        EXPECT_EQ(scene.names(*d), Names{"noise"}) << listing(*d, *scene.effects);
    }
    {  // a third more than stated: the factor is that of the stated noise, not of all that is expected to scatter
        Scene scene({}, {}, 1.3 * kNoise);
        const auto d = scene.run();
        ASSERT_TRUE(d);
        ASSERT_EQ(scene.names(*d), Names{"noise"}) << listing(*d, *scene.effects);
        EXPECT_NEAR(d->named()->fit.at.effects[0].values[0], 1.3, 0.07);
    }
    {
        Scene scene({{test::ToyBody::kMaterialLaw, law}});
        const auto d = scene.run();
        ASSERT_TRUE(d);
        EXPECT_EQ(scene.names(*d), Names{"material_law"}) << listing(*d, *scene.effects);
    }
}

TEST(Diagnosis, WithheldCauseIsUnknownNotSomethingElse) {
    const std::vector<double> v{0.15, -0.1, -0.35, 0.08, 0.03, 5.3};
    Scene scene({{test::ToyBody::kUnknownLoad, v}});
    const auto d = scene.run({"unknown_load"});
    ASSERT_TRUE(d) << d.error().text;
    EXPECT_EQ(d->named(), nullptr) << listing(*d, *scene.effects);
    EXPECT_GT(d->verdict.unknown_probability, 0.5);
    ASSERT_TRUE(d->where.center_m) << "the force map places what has no name";
    EXPECT_LT((Eigen::Vector3d((*d->where.center_m).data()) - Eigen::Vector3d(0.08, 0.03, 0.01)).norm(), 0.035)
        << "one patch (marker spacing 40-50 mm)";
    EXPECT_EQ(d->shrinkage.after_m, d->shrinkage.before_m)
        << "nothing was added: the model's error is not what is left";
    EXPECT_EQ(d->ladder.size(), 1);
}

// Judged with the numbers that it was made with, an answer stays what it is; with others, only its verdict changes.
TEST(Diagnosis, AnAnswerIsJudgedAgainFromItsEvidence) {
    using nlohmann::json;
    const std::vector<double> load{0.15, -0.1, -0.35, 0.08, 0.03, 5.3}, shift{0.004, -0.003, 0.005};
    Scene scene({{test::ToyBody::kUnknownLoad, load}}, {{test::ToyCamera::kRegistration, shift}});
    for (const std::vector<const char*>& excluded : {std::vector<const char*>{}, {"unknown_load"}}) {
        const auto d = scene.run(excluded);
        ASSERT_TRUE(d) << d.error().text;
        const std::string text = gap_json(*d, *scene.effects, scene.body, {});
        const json before = json::parse(text);
        const auto again = judged_again(text, {});
        ASSERT_TRUE(again) << again.error().text;
        const json after = json::parse(*again);
        ASSERT_EQ(after["causes"].size(), before["causes"].size());
        // What is too unlikely to be listed is not judged again.
        constexpr double kUnlisted = 3e-3;
        for (std::size_t k = 0; k < before["causes"].size(); ++k) {
            EXPECT_EQ(after["causes"][k]["effects"], before["causes"][k]["effects"]);
            EXPECT_EQ(after["causes"][k]["parameters"], before["causes"][k]["parameters"]);
            EXPECT_NEAR(after["causes"][k]["probability"].get<double>(),
                        before["causes"][k]["probability"].get<double>(), kUnlisted);
        }
        for (const char* other : {"unknown_probability", "none_probability"})
            EXPECT_NEAR(after[other].get<double>(), before[other].get<double>(), kUnlisted) << other;
        EXPECT_EQ(after["gap"], before["gap"]);
        EXPECT_EQ(after["where"], before["where"]);
        EXPECT_EQ(after["evidence"], before["evidence"]);

        const auto other = judged_again(text, {.none_bonus = 1e3});
        ASSERT_TRUE(other) << other.error().text;
        EXPECT_GT(json::parse(*other)["none_probability"].get<double>(), 0.9);
        EXPECT_FALSE(json::parse(*other)["gap"]["significant"].get<bool>());
    }
}

TEST(Diagnosis, OnlyEvidenceCanBeJudgedAgain) {
    for (const char* text : {"", "{", "[]", "{}", R"({"format": "teres-gap-1"})",
                             R"({"format": "teres-gap-1", "causes": [], "evidence": {"cost_nominal": "much"}})"}) {
        const auto again = judged_again(text, {});
        ASSERT_FALSE(again) << text;
        EXPECT_EQ(again.error().kind, ErrorKind::kInvalidInput) << text;
        EXPECT_NE(again.error().text.find("teres-gap-1"), std::string::npos) << again.error().text;
    }
}

TEST(Diagnosis, TwoCausesAreBothNamed) {
    const std::vector<double> load{0.15, -0.1, -0.35, 0.08, 0.03, 5.3}, shift{0.004, -0.003, 0.005};
    Scene scene({{test::ToyBody::kUnknownLoad, load}}, {{test::ToyCamera::kRegistration, shift}});
    const auto d = scene.run();
    ASSERT_TRUE(d) << d.error().text;
    EXPECT_EQ(scene.names(*d), (Names{"registration", "unknown_load"})) << listing(*d, *scene.effects);
    ASSERT_EQ(d->ladder.size(), 4u) << "nominal, one, both, both with the model's own error";
    EXPECT_LT(d->ladder[2].heldout_rms_m, d->ladder[1].heldout_rms_m);
    EXPECT_TRUE(d->ladder[3].model_error);
}

// The truth is stiffer on one side, more than the variant of the ensemble: what the fitted frames show of that holds in
// those never fitted and at the validation point, which nothing observes (it sits on the first marker).
TEST(Diagnosis, ModelErrorIsLearnedAndPredicted) {
    const std::vector<double> load{0.15, -0.1, -0.35, 0.08, 0.03, 5.3};
    for (const bool pulled : {false, true}) {
        std::vector<EffectInstance> effects;
        if (pulled) effects.push_back({test::ToyBody::kUnknownLoad, load});
        Scene scene(effects);
        const std::vector<double> theta{38.0, 70.0}, usual = scene.body.motion({theta, effects}, 1.02),
                                                     truth = scene.body.motion({theta, effects}, 1.0, 1.0);
        for (std::size_t row = 0; row < truth.size(); ++row) scene.observed[row] += truth[row] - usual[row];
        const auto d = scene.run();
        ASSERT_TRUE(d) << d.error().text;
        EXPECT_EQ(scene.names(*d), pulled ? Names{"unknown_load"} : Names{}) << listing(*d, *scene.effects);
        const Eigen::MatrixXd &D = d->discrepancy.columns, &at_point = d->discrepancy.at_points;
        ASSERT_EQ(at_point.rows(), static_cast<Eigen::Index>(3 * test::kToyFrames));
        for (Eigen::Index f = 0; f < static_cast<Eigen::Index>(test::kToyFrames); ++f)
            EXPECT_LT((at_point.middleRows<3>(3 * f) - D.middleRows<3>(3 * f * test::kToyMarkers)).norm(), 1e-12);

        const Assumption& fitted = d->named() != nullptr ? d->named()->fit.at : d->nominal.at;
        std::vector<EffectInstance> named;
        for (const ActiveEffect& e : fitted.effects)
            named.push_back({static_cast<std::int32_t>((*scene.effects)[e.entry].index), e.values});
        const std::vector<double> plain = scene.body.motion({fitted.theta, named});
        double without = 0.0, with = 0.0;
        for (std::size_t f = 0; f < test::kToyFrames; ++f)
            for (std::size_t a = 0; a < 3; ++a) {
                const std::size_t row = 3 * f * test::kToyMarkers + a;
                without += std::pow(plain[row] - truth[row], 2);
                with += std::pow(d->points_m[3 * f + a] - truth[row], 2);
            }
        EXPECT_LT(with, 0.2 * without) << (pulled ? "with a tool" : "without");
        const LadderStep &last = d->ladder.back(), &before_last = d->ladder[d->ladder.size() - 2];
        EXPECT_TRUE(last.model_error);
        EXPECT_EQ(last.effects, before_last.effects);
        EXPECT_LT(last.heldout_rms_m, before_last.heldout_rms_m);
        EXPECT_NEAR(d->shrinkage.after_m, last.heldout_rms_m, 1e-12);
        EXPECT_NEAR(d->shrinkage.before_m, d->ladder.front().heldout_rms_m, 1e-12) << "the nominal model as it is";
    }
}

// A camera that is off by less than the error of form that is expected of what else happens (5 % of what that
// explains).
TEST(Diagnosis, SensorBesideALargeMechanicalCauseIsNamed) {
    const std::vector<double> soft{0.25}, shift{0.0008, -0.0006, 0.001};
    Scene scene({{test::ToyBody::kStiffness, soft}}, {{test::ToyCamera::kRegistration, shift}});
    const auto d = scene.run();
    ASSERT_TRUE(d) << d.error().text;
    EXPECT_EQ(scene.names(*d), (Names{"registration", "stiffness"})) << listing(*d, *scene.effects);
}

// ... and a body that lies tilted by as little.
TEST(Diagnosis, WeightBesideALargeMechanicalCauseIsNamed) {
    const std::vector<double> soft{0.25}, tilt{0.075, -0.055, 0.09};
    Scene scene({{test::ToyBody::kStiffness, soft}, {test::ToyBody::kGravity, tilt}}, {});
    const auto d = scene.run();
    ASSERT_TRUE(d) << d.error().text;
    EXPECT_EQ(scene.names(*d), (Names{"gravity", "stiffness"})) << listing(*d, *scene.effects);
}

// A tool explains so much more than the weight does by first order that the weight is not worth a fit, but for what it
// may do where the tool was always there.
TEST(Diagnosis, TheWeightIsFittedWhereAToolThatWasAlwaysThereIsTheBest) {
    const auto weight_is_fitted = [](double onset_s) {
        const std::vector<double> tool{0.6, -0.4, -1.4, 0.12, 0.0, onset_s};
        Scene scene({{test::ToyBody::kUnknownLoad, tool}});
        const auto d = scene.run();
        EXPECT_TRUE(d && scene.names(*d) == Names{"unknown_load"}) << listing(*d, *scene.effects);
        return d && std::any_of(d->verdict.causes.begin(), d->verdict.causes.end(), [&](const Cause& c) {
                   return c.fit.usable && c.entries == std::vector{scene.effects->find("gravity")};
               });
    };
    EXPECT_TRUE(weight_is_fitted(0.0));
    EXPECT_FALSE(weight_is_fitted(6.0));
}

// A tool that comes in the frames kept for the end, behind an offset so large that the nominal fit does not see it: the
// named offset fails there, so markers are held out instead and both are named.
TEST(Diagnosis, LateEventBehindALargeOffsetIsNamed) {
    const std::vector<double> load{0.3, -0.2, -0.7, 0.08, 0.03, 10.7}, shift{0.012, -0.01, 0.014};
    Scene scene({{test::ToyBody::kUnknownLoad, load}}, {{test::ToyCamera::kRegistration, shift}});
    const auto d = scene.run();
    ASSERT_TRUE(d) << d.error().text;
    EXPECT_FALSE(d->recording.held_markers.empty());
    EXPECT_EQ(scene.names(*d), (Names{"registration", "unknown_load"})) << listing(*d, *scene.effects);
    ASSERT_TRUE(d->where.onset_s);
    EXPECT_NEAR(*d->where.onset_s, 10.7, 0.25);
}

// Nothing of a tool is to be seen before it comes, however hard it pulls then: the beginning tells the offset.
TEST(Diagnosis, BeginningTellsWhatALargerEventHides) {
    const std::vector<double> shift{0.003, -0.002, 0.003}, pull{0.6, -0.4, -1.2, 0.08, 0.03, 5.3};
    Scene scene({{test::ToyBody::kUnknownLoad, pull}}, {{test::ToyCamera::kRegistration, shift}});
    const auto d = scene.run();
    ASSERT_TRUE(d) << d.error().text;
    ASSERT_TRUE(d->screening.of_beginning);
    EXPECT_EQ((*scene.effects)[d->screening.of_beginning->entry].info.id, std::string("registration"));
    EXPECT_EQ(scene.names(*d), (Names{"registration", "unknown_load"})) << listing(*d, *scene.effects);

    Scene alone({{test::ToyBody::kUnknownLoad, pull}});
    const auto without = alone.run();
    ASSERT_TRUE(without) << without.error().text;
    EXPECT_FALSE(without->screening.of_beginning) << "nothing is amiss before the tool comes";
}

// A frame that is nearly unstable says how far the model may be off there, and nothing about other frames.
TEST(Diagnosis, VariantInAnotherEquilibriumWeighsItsFrameOnly) {
    const auto ensemble = [](std::int32_t snaps_at, std::int32_t fails_at) {
        Scene scene({});
        scene.body.snaps_at = snaps_at;
        scene.body.fails_at = fails_at;
        const EffectTable effects(scene.body, &scene.camera, {});
        Simulator simulator(scene.body, &scene.camera, effects);
        return *discrepancy_of(simulator, {}, 5, {});
    };
    const Discrepancy calm = ensemble(-1, -1);
    ASSERT_GT(calm.columns.norm(), 0.0);
    for (const auto& [snaps_at, fails_at] : {std::pair{26, -1}, std::pair{-1, 26}}) {
        const Discrepancy d = ensemble(snaps_at, fails_at);
        EXPECT_EQ(d.runs, 2);
        EXPECT_NEAR(d.columns.norm(), calm.columns.norm(), 0.2 * calm.columns.norm());
        EXPECT_NEAR(d.remainder_m(45), calm.remainder_m(45), 1e-6);
        if (snaps_at > 0)
            EXPECT_NEAR(d.remainder_m(26), 0.05 / std::sqrt(2.0), 1e-3) << "one variant of two";
        else
            EXPECT_GT(d.remainder_m(26), calm.remainder_m(26));
    }
}

// Half as stiff everywhere, the body moves twice as far, and so do the variants' differences.
TEST(Diagnosis, EnsembleUnderACauseIsThatOfItsMotion) {
    Scene scene({});
    const EffectTable effects(scene.body, &scene.camera, {});
    Simulator simulator(scene.body, &scene.camera, effects);
    const auto nominal = discrepancy_about(simulator, {{50.0, 50.0}, {}}, {}),
               soft = discrepancy_about(simulator, {{25.0, 25.0}, {{effects.find("stiffness"), {0.5}}}}, {});
    ASSERT_TRUE(nominal && soft);
    EXPECT_NEAR(soft->columns.norm() / nominal->columns.norm(), 2.0, 0.01);
    EXPECT_NEAR(soft->at_points.norm() / nominal->at_points.norm(), 2.0, 0.01);
    scene.body.converges = false;
    EXPECT_FALSE(discrepancy_about(simulator, {{25.0, 25.0}, {}}, {}));
}

// Hypotheses fitted two at a time by two models: the same answer to the last digit that matters.
TEST(Diagnosis, TwoModelsSayWhatOneSays) {
    const std::vector<double> load{0.15, -0.1, -0.35, 0.08, 0.03, 5.3}, shift{0.004, -0.003, 0.005};
    Scene one({{test::ToyBody::kUnknownLoad, load}}, {{test::ToyCamera::kRegistration, shift}});
    const auto alone = one.run();
    test::ToyBody twin;
    one.body.second = &twin;
    const auto both = one.run();
    ASSERT_TRUE(alone && both);
    EXPECT_GT(twin.simulations, 0) << "it takes its part";
    ASSERT_EQ(alone->verdict.causes.size(), both->verdict.causes.size());
    for (std::size_t k = 0; k < alone->verdict.causes.size(); ++k) {
        EXPECT_EQ(alone->verdict.causes[k].entries, both->verdict.causes[k].entries);
        EXPECT_NEAR(alone->verdict.causes[k].probability, both->verdict.causes[k].probability, 1e-9);
    }
    EXPECT_EQ(alone->discrepancy.columns, both->discrepancy.columns);
}

TEST(WorkLimit, TellsWhenHalfIsUsed) {
    const WorkLimit none(0.0), limit(0.4);
    EXPECT_TRUE(limit.leaves_as_much());
    const std::clock_t start = std::clock();
    while (std::clock() - start < CLOCKS_PER_SEC / 4) {
    }
    EXPECT_FALSE(limit.leaves_as_much());
    EXPECT_TRUE(none.leaves_as_much());
    EXPECT_FALSE(none.reached());
}

TEST(ShareWork, EvenAndOddAndWhatIsThrown) {
    for (const bool two : {false, true}) {
        std::vector<std::size_t> who(7, 9);
        share_work(two, who.size(), [&](std::size_t w, std::size_t k) { who[k] = w; });
        EXPECT_EQ(who, two ? (std::vector<std::size_t>{0, 1, 0, 1, 0, 1, 0}) : std::vector<std::size_t>(7, 0));
        for (const std::size_t bad : {2u, 3u})
            EXPECT_THROW(share_work(two, 7,
                                    [&](std::size_t, std::size_t k) {
                                        if (k == bad) throw std::runtime_error("of one");
                                    }),
                         std::runtime_error);
    }
    share_work(true, 0, [](std::size_t, std::size_t) { FAIL(); });
}

TEST(Diagnosis, BadRecordingsAreRefusedWithTheReason) {
    Scene scene({});
    for (std::size_t f = 0; f < test::kToyFrames; ++f)
        for (std::size_t a = 0; a < 3; ++a) scene.observed[3 * (f * test::kToyMarkers + 2) + a] = NAN;
    const auto lost = scene.run();
    ASSERT_FALSE(lost);
    EXPECT_NE(lost.error().text.find("marker 12 is lost throughout"), std::string::npos) << lost.error().text;

    Scene stuck({});
    stuck.body.converges = false;
    const auto d = stuck.run();
    ASSERT_FALSE(d);
    EXPECT_EQ(d.error().kind, ErrorKind::kNotUsable);
}

TEST(Diagnosis, EnsembleIsComputedOncePerBody) {
    const test::ScratchFolder scratch;
    Scene scene({});
    const EffectTable effects(scene.body, &scene.camera, {});
    Simulator simulator(scene.body, &scene.camera, effects);
    const auto first = discrepancy_of(simulator, scratch.path() / "cache", 5, {});
    ASSERT_TRUE(first);
    EXPECT_EQ(first->runs, 2) << "two variants";
    EXPECT_FALSE(first->from_cache);
    const auto second = discrepancy_of(simulator, scratch.path() / "cache", 5, {});
    ASSERT_TRUE(second);
    EXPECT_TRUE(second->from_cache);
    EXPECT_EQ(first->columns, second->columns);
    const auto other = discrepancy_of(simulator, scratch.path() / "cache", 6, {});
    ASSERT_TRUE(other);
    EXPECT_FALSE(other->from_cache) << "another body";
}

}  // namespace
}  // namespace teres
