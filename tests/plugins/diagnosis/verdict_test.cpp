// From costs to probabilities, by hand: floor 1 (all model error), nominal cost 10, nu 45, so that `unknown` leaves
// 0.5 + 0.03 (10 - 0.5) = 0.785 and gains 22.5 ln((1 + 10) / (1 + 0.785)) = 40.9 nats; it pays 9 at least.
#include "plugins/diagnosis/verdict.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/toy_body.h"

namespace teres {
namespace {

constexpr ErrorFloor kFloor{0.0, 1.0};
constexpr double kNominal = 10.0;
const Calibration kEvidence{.lapse = 0.0};  // what the costs say, without the doubt that stays whatever they say

Cause fitted(std::vector<std::size_t> entries, double misfit, double price, double nominal = kNominal) {
    Cause cause;
    cause.entries = std::move(entries);
    cause.fit.usable = true;
    cause.misfit = misfit;
    cause.price.occam = price;
    cause.score = 22.5 * std::log(kFloor.above(nominal) / kFloor.above(misfit)) - price;
    return cause;
}

double probability_of(const Verdict& verdict, const std::vector<std::size_t>& entries) {
    for (const Cause& cause : verdict.causes)
        if (cause.entries == entries) return cause.probability;
    return 0.0;
}

TEST(Verdict, UnknownGainsWhatWouldReachTheFloorButForAShare) {
    EXPECT_NEAR(unknown_gain(kNominal, kFloor, {}), 22.5 * std::log(11.0 / 1.785), 1e-9);
    EXPECT_EQ(unknown_gain(0.5, kFloor, {}), 0.0) << "nothing above the floor";
}

TEST(Verdict, ASingleCauseThatLeavesMuchIsUnknown) {
    const Verdict verdict = judge({fitted({0}, 6.0, 5.0)}, kNominal, kFloor, {});
    EXPECT_GT(verdict.unknown_probability, 0.9);
}

// What looser forms of the best cause explain (it leaves 3, beside them 2.5) is no evidence for
// something else.
TEST(Verdict, UnknownIsWorthWhatItGainsBesideFormsOfTheBest) {
    const auto lead_of_unknown = [](const Cause& cause) {
        const Verdict verdict = judge({cause, fitted({1}, 8.0, 5.0)}, kNominal, kFloor, kEvidence);
        return Calibration{}.temperature * std::log(verdict.unknown_probability / probability_of(verdict, {0}));
    };
    Cause cause = fitted({0}, 3.0, 5.0);
    const double alone = 22.5 * std::log(4.0 / 1.785) - 9.0 + 5.0;
    EXPECT_NEAR(lead_of_unknown(cause), alone, 1e-6);
    cause.misfit_beside_forms = 2.5;
    EXPECT_NEAR(lead_of_unknown(cause), alone - 22.5 * std::log(4.0 / 3.5), 1e-6);
    cause.misfit_beside_forms = 3.5;  // never more evidence
    EXPECT_NEAR(lead_of_unknown(cause), alone, 1e-6);
    // A cut or a support is expected to leave a fifth of the 7 that it explains: 3 may be 1.6.
    cause.rough_form = true;
    EXPECT_NEAR(lead_of_unknown(cause), alone - 22.5 * std::log(4.0 / 2.6), 1e-6);
    cause.misfit_beside_forms = 1.5;  // the larger of both, not their sum
    EXPECT_NEAR(lead_of_unknown(cause), alone - 22.5 * std::log(4.0 / 2.5), 1e-6);
    cause.rough_form = false;
    cause.lets_go = true;  // other forms of such a cut are a torn ligament's
    EXPECT_NEAR(lead_of_unknown(cause), alone, 1e-6);
}

// What other forms of the rest of a set explain as well (2.0 nats, which its score leaves out) is no more evidence for
// an unknown effect than for the set's last one.
TEST(Verdict, WhatFormsOfTheRestOfASetExplainSpeaksNoMoreForUnknown) {
    const auto lead_of_unknown = [](Cause pair, double form_nats) {
        pair.form_nats = form_nats;
        pair.score -= form_nats;
        const Verdict verdict = judge({pair, fitted({0}, 8.0, 5.0)}, kNominal, kFloor, kEvidence);
        return Calibration{}.temperature * std::log(verdict.unknown_probability / probability_of(verdict, {0, 1}));
    };
    Cause pair = fitted({0, 1}, 3.0, 5.0);
    const double alone = lead_of_unknown(pair, 0.0);
    EXPECT_NEAR(lead_of_unknown(pair, 2.0), alone, 1e-6);
    pair.rough_form = true;  // the larger of both, not their sum: a fifth of the 7 that it explains is worth more
    EXPECT_NEAR(lead_of_unknown(pair, 2.0), alone - 22.5 * std::log(4.0 / 2.6) + 2.0, 1e-6);
}

// Where the model may be off by 2 under the best cause, `unknown` leaves 1.0 + 0.03 (10 - 1.0) = 1.27.
TEST(Verdict, UnknownReachesTheModelErrorOfTheStateUnderTheBest) {
    const auto lead_of_unknown = [](double model_error) {
        Cause cause = fitted({0}, 3.0, 5.0);
        cause.model_error = model_error;
        const Verdict verdict = judge({cause, fitted({1}, 8.0, 5.0)}, kNominal, kFloor, kEvidence);
        return Calibration{}.temperature * std::log(verdict.unknown_probability / probability_of(verdict, {0}));
    };
    EXPECT_NEAR(lead_of_unknown(2.0), 22.5 * std::log(4.0 / 2.27) - 9.0 + 5.0, 1e-6);
    EXPECT_NEAR(lead_of_unknown(0.5), 22.5 * std::log(4.0 / 1.785) - 9.0 + 5.0, 1e-6) << "never less than at rest";
}

// The pair leaves half the floor at 20 nats; the single cause leaves 6 at 5 nats. An unknown effect would pay at least
// what the pair pays.
TEST(Verdict, APairThatExplainsEverythingIsNotUnknown) {
    const Verdict verdict = judge({fitted({0}, 6.0, 5.0), fitted({0, 1}, 0.5, 20.0)}, kNominal, kFloor, {});
    EXPECT_GT(probability_of(verdict, {0, 1}), 0.9);
    EXPECT_LT(verdict.unknown_probability, 0.1);
}

// ... nor at 45 nats, as much as a breath and a tear cost: by the numbers below an unknown effect that paid 32 would be
// 6 nats ahead.
TEST(Verdict, APairIsNotUnknownForBeingDear) {
    constexpr double kLarge = 60.0;
    const Cause single = fitted({0}, 20.0, 5.0, kLarge), pair = fitted({0, 1}, 1.5, 45.0, kLarge);
    const Verdict verdict = judge({single, pair}, kLarge, kFloor, {});
    EXPECT_GT(probability_of(verdict, {0, 1}), 0.9);
}

// A single cause leaves 3 at 5 nats, the best; a pair 0.5 at 30. An unknown effect in place of the single one does not
// pay what the pair does, only the least.
TEST(Verdict, InPlaceOfASingleCauseUnknownDoesNotPayForASet) {
    const Cause single = fitted({0}, 3.0, 5.0), pair = fitted({0, 1}, 0.5, 30.0);
    ASSERT_GT(single.score, pair.score);
    const Verdict verdict = judge({single, pair}, kNominal, kFloor, kEvidence);
    EXPECT_NEAR(Calibration{}.temperature * std::log(verdict.unknown_probability / probability_of(verdict, {0})),
                22.5 * std::log(4.0 / 1.785) - 9.0 + 5.0, 1e-6);
}

// A sensor leaves 2 at 5 nats: in its place something else would leave 0.65 of the model's error and, however large the
// gap, nothing of what is above it.
TEST(Verdict, InPlaceOfSensorsUnknownLeavesNothingOfWhatTheyExplain) {
    const auto lead_of_unknown = [](double nominal, bool sensors) {
        Cause cause = fitted({0}, 2.0, 5.0, nominal);
        cause.sensors = sensors;
        const Verdict verdict = judge({cause}, nominal, kFloor, kEvidence);
        return Calibration{}.temperature * std::log(verdict.unknown_probability / probability_of(verdict, {0}));
    };
    for (const double nominal : {10.0, 40.0}) {
        EXPECT_NEAR(lead_of_unknown(nominal, true), 22.5 * std::log(3.0 / 1.65) - 9.0 + 5.0, 1e-6);
        EXPECT_NEAR(lead_of_unknown(nominal, false), 22.5 * std::log(3.0 / (1.5 + 0.03 * (nominal - 0.5))) - 9.0 + 5.0,
                    1e-6);
    }
}

// ... beside others it leaves 3 % of what the sensors alone would leave, 6, as they were fitted; what leaves more than
// the nominal model, or is not of the set, does not count.
TEST(Verdict, InPlaceOfASetUnknownLeavesAShareOfWhatItsSensorsLeave) {
    const auto lead_of_unknown = [](const std::vector<Cause>& others) {
        std::vector<Cause> causes{fitted({0, 1}, 3.0, 12.0)};
        causes.insert(causes.end(), others.begin(), others.end());
        const Verdict verdict = judge(causes, kNominal, kFloor, kEvidence);
        return Calibration{}.temperature * std::log(verdict.unknown_probability / probability_of(verdict, {0, 1}));
    };
    const auto sensor = [](std::size_t entry, double misfit) {
        Cause cause = fitted({entry}, misfit, 5.0);
        cause.sensors = true;
        return cause;
    };
    constexpr double kTrace = 1e-4;  // of what is there unseen
    const double of_nominal = 22.5 * std::log(4.0 / 1.785) - 1.0;
    EXPECT_NEAR(lead_of_unknown({}), of_nominal, kTrace);
    EXPECT_NEAR(lead_of_unknown({fitted({0}, 6.0, 5.0)}), of_nominal, kTrace) << "no sensor";
    EXPECT_NEAR(lead_of_unknown({sensor(2, 6.0)}), of_nominal, kTrace) << "not of the set";
    EXPECT_NEAR(lead_of_unknown({sensor(0, 12.0)}), of_nominal, kTrace);
    EXPECT_NEAR(lead_of_unknown({sensor(0, 6.0), sensor(1, 8.0)}), 22.5 * std::log(4.0 / (1.5 + 0.03 * 5.5)) - 1.0,
                kTrace);
}

// A cause that leaves what `unknown` would at a price of 12 nats keeps it a nat behind; where 8 of these are for scales
// that are not its own, something else needs none of them.
TEST(Verdict, UnknownDoesNotPayForScalesBentIntoPlace) {
    const auto lead_of_unknown = [](double scales) {
        Cause cause = fitted({0}, 0.785, 12.0);
        cause.price.occam -= scales;
        cause.price.scales = scales;
        const Verdict verdict = judge({cause}, kNominal, kFloor, kEvidence);
        return Calibration{}.temperature * std::log(verdict.unknown_probability / probability_of(verdict, {0}));
    };
    EXPECT_NEAR(lead_of_unknown(0.0), -1.0, 1e-6);
    EXPECT_NEAR(lead_of_unknown(4.0), 4.0 - 1.0, 1e-6);
    EXPECT_NEAR(lead_of_unknown(8.0), 12.0 - 9.0, 1e-6) << "never for less than the least";
}

// A cause that leaves what `unknown` would at 20 nats, some of them for amplitudes that such an effect hardly ever has:
// something else is of usual size.
TEST(Verdict, UnknownDoesNotPayForExtremeAmplitudes) {
    const auto lead_of_unknown = [](double extreme) {
        Cause cause = fitted({0}, 0.785, 20.0);
        cause.price.occam -= 9.0;
        cause.price.tail = 9.0;
        cause.price.extreme = extreme;
        const Verdict verdict = judge({cause}, kNominal, kFloor, kEvidence);
        return kEvidence.temperature * std::log(verdict.unknown_probability / probability_of(verdict, cause.entries));
    };
    EXPECT_NEAR(lead_of_unknown(0.0), -1.0, 1e-6);
    EXPECT_NEAR(lead_of_unknown(6.0), 6.0 - 1.0, 1e-6);
}

// A force of three components of 5 prior deviations each; twice the prior is no extreme.
TEST(Verdict, AmplitudesBeyondTwiceTheirPriorAreExtreme) {
    test::ToyBody body;
    const EffectTable effects(body, nullptr, {});
    Fit nominal;
    nominal.u = Eigen::VectorXd::Zero(2);
    nominal.cost = kNominal;
    const auto priced = [&](double deviations) {
        Cause cause;
        cause.entries = {test::ToyBody::kGravity};
        cause.fit.at.effects = {effects.candidate(test::ToyBody::kGravity, 0)};
        cause.fit.u = Eigen::VectorXd::Zero(2 + 3);
        cause.fit.u.tail(3).setConstant(deviations);
        cause.fit.J = Eigen::MatrixXd::Zero(4, 2 + 3);
        cause.fit.cost = 1.0 + cause.fit.u.squaredNorm();
        refit_score(nominal, cause, effects, kFloor, {});
        return cause.price;
    };
    EXPECT_EQ(priced(2.0).extreme, 0.0);
    EXPECT_NEAR(priced(5.0).tail, 3.5 * std::log(1.0 + 75.0 / 4.0), 1e-9);
    EXPECT_NEAR(priced(5.0).extreme, 3.5 * std::log((1.0 + 75.0 / 4.0) / (1.0 + 12.0 / 4.0)), 1e-9);
}

// The rise of a load has an expected duration; where and when it comes has not, if it does in the recording, nor has
// its force.
TEST(Verdict, AScaleFarFromWhatIsExpectedHasItsPrice) {
    test::ToyBody body;
    body.sudden = true;
    const EffectTable effects(body, nullptr, {});
    Fit nominal;
    nominal.u = Eigen::VectorXd::Zero(2);
    nominal.cost = kNominal;
    const auto priced = [&](double place, double duration, double onset_s = 3.0) {
        Cause cause;
        cause.entries = {test::ToyBody::kUnknownLoad};
        cause.fit.at.effects = {effects.candidate(test::ToyBody::kUnknownLoad, 0)};
        cause.fit.at.effects[0].values[5] = onset_s;
        cause.fit.u = Eigen::VectorXd::Zero(2 + 7);
        cause.fit.u(2 + 3) = cause.fit.u(2 + 5) = place;  // centre, onset [prior standard deviations]
        cause.fit.u(2 + 6) = duration;
        cause.fit.J = Eigen::MatrixXd::Zero(4, 2 + 7);
        cause.fit.cost = 1.0 + cause.fit.u.squaredNorm();
        const double score = refit_score(nominal, cause, effects, kFloor, {});
        return std::pair(cause.price.scales, score);
    };
    EXPECT_EQ(priced(3.0, 0.0).first, 0.0);
    const auto [far, score] = priced(0.0, -3.0);
    EXPECT_NEAR(far, 2.5 * std::log(1.0 + 9.0 / 4.0), 1e-12) << "Student's t of four degrees of freedom";
    EXPECT_NEAR(priced(0.0, 0.0).second - score, far, 1e-9);
    EXPECT_NEAR(priced(-3.0, 0.0, 0.0).first, far, 1e-12) << "a load that was there from the beginning";
}

// Two mechanical effects of one course in time may stand for the error of form of one; what happens and what is there
// from the beginning have not one course.
TEST(Verdict, AnEventBesideWhatIsThereFromTheBeginningIsNoErrorOfForm) {
    using Toy = test::ToyBody;
    Toy body;
    const EffectTable effects(body, nullptr, {});
    Fit nominal;
    nominal.u = Eigen::VectorXd::Zero(2);
    nominal.cost = kNominal;
    const auto price_of_further = [&](std::vector<std::size_t> entries, double onset_s = 3.0) {
        Eigen::Index columns = 2;
        Cause cause;
        for (const std::size_t e : entries) {
            columns += effects[e].info.num_parameters;
            cause.fit.at.effects.push_back(effects.candidate(e, 0));
            if (e == Toy::kUnknownLoad) cause.fit.at.effects.back().values[5] = onset_s;
        }
        cause.entries = std::move(entries);
        cause.fit.u = Eigen::VectorXd::Zero(columns);
        cause.fit.J = Eigen::MatrixXd::Zero(4, columns);
        cause.fit.cost = 1.0;
        refit_score(nominal, cause, effects, kFloor, {});
        return cause.price.further;
    };
    EXPECT_EQ(price_of_further({Toy::kGravity}), 0.0);
    EXPECT_EQ(price_of_further({Toy::kGravity, Toy::kStiffness}), 3.0 + 5.0) << "both steady";
    EXPECT_EQ(price_of_further({Toy::kUnknownLoad, Toy::kCut}), 3.0 + 5.0) << "both happen";
    EXPECT_EQ(price_of_further({Toy::kUnknownLoad, Toy::kStiffness}), 3.0) << "one happens";
    EXPECT_EQ(price_of_further({Toy::kUnknownLoad, Toy::kStiffness}, 0.5), 3.0 + 5.0) << "from the beginning";
    EXPECT_EQ(price_of_further({Toy::kUnknownLoad, Toy::kStiffness, Toy::kGravity}), 6.0 + 5.0);
}

// A heartbeat leaves what the loads move as it is (4 of 10; the model may be off by 4) and takes away the 6 that have a
// course of their own, of which the model's error explains 0.1: 22.5 ln(6.1 / 0.1) nats more than its price.
TEST(Verdict, WhatHasACourseOfItsOwnIsNotTheModelsError) {
    const ErrorFloor floor{.noise = 0.0, .model = 4.0, .noise_beside = 0.0, .model_beside = 0.1};
    const Left nominal(10.0, 6.0);
    Fit without;
    without.cost = nominal.cost;
    without.beside = nominal.beside;
    Cause heart = fitted({0}, 4.0, 25.0);
    const auto evidence = [&](const ErrorFloor& by) {
        return 22.5 * (by.log_above(nominal) - by.log_above({4.0, 0.0}));
    };
    heart.score = evidence(floor) - 25.0;
    EXPECT_NEAR(evidence(floor), 22.5 * std::log(6.1 / 0.1), 1e-9);
    EXPECT_NEAR(told_apart(without, heart, floor, {}), evidence(floor) - 22.5 * std::log(14.0 / 8.0), 1e-9);
    EXPECT_GT(probability_of(judge({heart}, nominal, floor, {}), {0}), 0.5);
    const ErrorFloor together{0.0, 4.0};
    heart.score = evidence(together) - 25.0;
    EXPECT_LT(probability_of(judge({heart}, nominal, together, {}), {0}), 0.1);
}

TEST(Verdict, NothingBeyondTheFloorIsNone) {
    const Verdict verdict = judge({fitted({0}, 1.0, 5.0, 1.2)}, 1.2, kFloor, {});
    EXPECT_GT(verdict.none_probability, 0.8);
}

// Thirty effects of score 0: none of them shows, however many there are; the better of two that hardly do stays ahead.
TEST(Verdict, EffectsThatDoNotShowDoNotWeighAgainstNone) {
    std::vector<Cause> causes;
    for (std::size_t k = 0; k < 30; ++k) causes.push_back(fitted({k}, 1.0, 0.0, 1.0));
    causes.push_back(fitted({30}, 1.0, 1.0, 1.0));
    const Verdict verdict = judge(causes, 1.0, kFloor, {});
    EXPECT_GT(verdict.none_probability, 0.8);
    EXPECT_LT(probability_of(verdict, {30}), probability_of(verdict, {0}));
}

// Five nats above nothing beat the bonus of `none`, one does not (the gap is too small for `unknown`).
TEST(Verdict, ACauseIsNamedIfItBeatsTheBonusOfNone) {
    const double nominal = 1.6, gain = 22.5 * std::log(2.6 / 2.0);
    EXPECT_GT(probability_of(judge({fitted({0}, 1.0, gain - 5.0, nominal)}, nominal, kFloor, {}), {0}), 0.5);
    EXPECT_GT(judge({fitted({0}, 1.0, gain - 1.0, nominal)}, nominal, kFloor, {}).none_probability, 0.5);
}

// The nominal cost is the floor itself: an effect that explains all of it may bend our own error into place.
TEST(Verdict, WhatTheModelsErrorMayBeIsLittleEvidence) {
    const Cause all = fitted({0}, 0.0, 2.0, 1.0);
    ASSERT_NEAR(all.score, 22.5 * std::log(2.0 / 1.0) - 2.0, 1e-9);
    const Verdict within = judge({all}, 1.0, kFloor, kEvidence);
    // exp(3 - 3.5) to one, tempered
    EXPECT_NEAR(probability_of(within, {0}) / within.none_probability, std::exp(-0.5 / 1.5), 0.02);
    const Verdict beyond = judge({fitted({0}, 0.0, 2.0, 1.6)}, 1.6, kFloor, kEvidence);
    EXPECT_GT(probability_of(beyond, {0}), 0.95);
}

// A large gap that one effect could explain, but at a price that outweighs it: nobody knows what it is.
TEST(Verdict, ACauseThatCostsMoreThanItExplainsLeavesUnknown) {
    const Cause dear = fitted({0}, kFloor.total(), 40.0);
    ASSERT_LT(dear.score, 0.0);
    Cause screened;
    screened.entries = {1};
    screened.score = -0.1;
    const Verdict verdict = judge({dear, screened}, kNominal, kFloor, {});
    EXPECT_GT(verdict.unknown_probability, 0.9);
}

// A cause that explains all of a large gap, beside one that is 20 nats behind and one that was only screened: 6 % stay,
// two thirds of them with what else was fitted and with what nobody thought of. That something is there is as sure as
// before, and so is the order.
TEST(Verdict, WhatIsCertainByItsEvidenceKeepsADoubt) {
    Cause screened;
    screened.entries = {2};
    screened.score = -5.0;
    const std::vector<Cause> causes{fitted({0}, 0.0, 2.0), fitted({1}, 0.0, 22.0), screened};
    const Verdict sure = judge(causes, kNominal, kFloor, kEvidence), doubtful = judge(causes, kNominal, kFloor, {});
    ASSERT_GT(probability_of(sure, {0}), 0.999);
    EXPECT_NEAR(probability_of(doubtful, {0}), 0.94 + 0.02, 1e-3);
    EXPECT_NEAR(probability_of(doubtful, {1}), 0.02, 1e-3);
    EXPECT_NEAR(doubtful.unknown_probability, 0.02, 1e-3);
    EXPECT_LT(probability_of(doubtful, {2}), 1e-6);
    EXPECT_EQ(doubtful.none_probability, sure.none_probability);
}

TEST(Verdict, ProbabilitiesSumToOne) {
    const Verdict verdict =
        judge({fitted({0}, 3.0, 8.0), fitted({1}, 2.0, 9.0), fitted({0, 1}, 0.5, 20.0)}, kNominal, kFloor, {});
    double sum = verdict.none_probability + verdict.unknown_probability;
    for (const Cause& cause : verdict.causes) sum += cause.probability;
    EXPECT_NEAR(sum, 1.0, 1e-12);
}

}  // namespace
}  // namespace teres
