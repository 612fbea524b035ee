#include "plugins/diagnosis/screening.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "plugins/diagnosis/amplitude_price.h"
#include "plugins/diagnosis/white_noise.h"

namespace teres {
namespace {

constexpr std::int32_t kFewCandidates = 3;  // of a mechanical effect where each costs a whole simulation
constexpr double kApart = 0.12;             // least distance of the best places, share of the extent of all

// A (I + J J^T)-weighted inner product without forming the matrix: <a, b> = a.b - (J'a)'(I + J'J)^-1 (J'b).
class NuisanceMetric {
  public:
    explicit NuisanceMetric(const Eigen::MatrixXd& J)
        : L_(Eigen::MatrixXd(Eigen::MatrixXd::Identity(J.cols(), J.cols()) + J.transpose() * J).llt()), J_(J) {}
    /// (I + J J^T)^-1 X
    Eigen::MatrixXd weigh(const Eigen::MatrixXd& X) const { return X - J_ * L_.solve(J_.transpose() * X); }

  private:
    Eigen::LLT<Eigen::MatrixXd> L_;
    const Eigen::MatrixXd& J_;
};

double log_mean_exp(const std::vector<double>& values) {
    const double top = *std::max_element(values.begin(), values.end());
    double sum = 0.0;
    for (const double v : values) sum += std::exp(v - top);
    return top + std::log(sum / static_cast<double>(values.size()));
}

// Amplitude shares a (1: the candidate's value) that a physical parameter can take.
struct ShareBounds {
    double lower, upper;
};
ShareBounds share_bounds(const EffectParameter& p, double candidate) {
    const double span = candidate - p.null_value;
    if (span == 0.0) return {0.0, 0.0};
    const bool log = p.transform == EffectTransform::kLog && p.null_value > 0.0;
    const auto share = [&](double physical) {
        if (!log) return (physical - p.null_value) / span;
        return std::log(std::max(physical, 1e-300) / p.null_value) / std::log(candidate / p.null_value);
    };
    const double a = share(p.lower), b = share(p.upper);
    return {std::min(a, b), std::max(a, b)};
}

// A candidate with the shares `a` of its amplitudes.
ActiveEffect scaled(const EffectEntry& entry, const ActiveEffect& full, const std::vector<std::size_t>& amplitude,
                    const Eigen::VectorXd& a) {
    ActiveEffect out = full;
    for (std::size_t i = 0; i < amplitude.size(); ++i) {
        const EffectParameter& p = entry.parameters[amplitude[i]];
        const double share = std::clamp(a(static_cast<Eigen::Index>(i)), -4.0, 4.0);
        out.values[amplitude[i]] = std::clamp(at_share(p, full.values[amplitude[i]], share), p.lower, p.upper);
    }
    return out;
}

// Whether two candidates move the same amplitudes away from null.
bool same_amplitudes(const EffectEntry& entry, const ActiveEffect& a, const ActiveEffect& b) {
    for (std::size_t p = 0; p < entry.parameters.size(); ++p) {
        const EffectParameter& parameter = entry.parameters[p];
        if (parameter.role == EffectRole::kAmplitude &&
            (a.values[p] == parameter.null_value) != (b.values[p] == parameter.null_value))
            return false;
    }
    return true;
}

// Keeps the best candidate of each place, for each set of amplitudes.
void take_place(const EffectTable& table, std::size_t e, PlaceGain gain, std::vector<PlaceGain>& places) {
    const ActiveEffect full = table.candidate(e, gain.candidate);
    const auto centre = centre_of(table[e], full);
    if (!centre) return;
    gain.centre_m = *centre;
    const auto same = std::find_if(places.begin(), places.end(), [&](const PlaceGain& p) {
        return p.centre_m == *centre && same_amplitudes(table[e], table.candidate(e, p.candidate), full);
    });
    if (same == places.end())
        places.push_back(std::move(gain));
    else if (gain.score > same->score)
        *same = std::move(gain);
}

// Parameter of each amplitude.
std::vector<std::size_t> amplitudes_of(const EffectEntry& entry) {
    std::vector<std::size_t> amplitude;
    for (std::size_t p = 0; p < entry.parameters.size(); ++p)
        if (entry.parameters[p].role == EffectRole::kAmplitude) amplitude.push_back(p);
    return amplitude;
}

// What a candidate explains: amplitudes within their bounds [prior standard deviations], the cost that they leave, what
// the data say of them.
struct Weighed {
    Eigen::VectorXd a;
    double cost = 0.0;
    Eigen::MatrixXd S;
};

// The residual at the prior mean of the nuisance J, and the signatures G, in its metric (I + J J^T)^-1.
struct Residual {
    Residual(Eigen::MatrixXd signatures, const Fit& base, Eigen::Index used) : G(std::move(signatures)) {
        const Eigen::MatrixXd J = base.J.topRows(used);
        const NuisanceMetric metric(J);
        const Eigen::VectorXd r = base.residual.head(used) + J * base.u;
        weighted_G = metric.weigh(G);
        weighted_r = metric.weigh(r);
        cost_null = r.dot(weighted_r);
    }
    Weighed weigh(const EffectEntry& entry, const ActiveEffect& full, const Signatures::Candidate& c) const {
        const auto columns = G.middleCols(c.first, c.count);
        Weighed w;
        w.S = columns.transpose() * weighted_G.middleCols(c.first, c.count);
        const Eigen::VectorXd b = columns.transpose() * weighted_r;
        w.a = (w.S + Eigen::MatrixXd::Identity(c.count, c.count)).ldlt().solve(b);
        const std::vector<std::size_t> amplitude = amplitudes_of(entry);
        for (Eigen::Index i = 0; i < c.count; ++i) {
            const std::size_t p = amplitude[static_cast<std::size_t>(i)];
            const ShareBounds bounds = share_bounds(entry.parameters[p], full.values[p]);
            w.a(i) = std::clamp(w.a(i), bounds.lower, bounds.upper);
        }
        w.cost = std::max(cost_null - 2.0 * b.dot(w.a) + w.a.dot(w.S * w.a), 1e-3 * cost_null);
        return w;
    }
    // The effect `noise` moves nothing; it is worth the white part of what is left, beyond what is stated.
    Weighed as_noise(const ErrorFloor& floor, double factor, Eigen::Index count) const {
        return {Eigen::VectorXd::Constant(count, factor - 1.0), floor.beside_noise(cost_null, factor).cost,
                Eigen::MatrixXd::Zero(count, count)};
    }

    Eigen::MatrixXd G, weighted_G;
    Eigen::VectorXd weighted_r;
    double cost_null = 0.0;
};

}  // namespace

double apart_m(const std::vector<PlaceGain>& places) {
    Eigen::AlignedBox3d box;
    for (const PlaceGain& place : places) box.extend(place.centre_m);
    return box.isEmpty() ? 0.0 : kApart * box.diagonal().norm();
}

std::vector<PlaceGain> best_places(std::vector<PlaceGain> places, std::size_t count) {
    const double apart = apart_m(places);
    std::stable_sort(places.begin(), places.end(), [](const auto& a, const auto& b) { return a.score > b.score; });
    std::vector<PlaceGain> chosen;
    for (PlaceGain& place : places)
        if (chosen.size() < count && std::none_of(chosen.begin(), chosen.end(), [&](const PlaceGain& c) {
                return (c.centre_m - place.centre_m).norm() < apart;
            }))
            chosen.push_back(std::move(place));
    return chosen;
}

Signatures signatures(Simulator& simulator, const Fit& base, const std::vector<std::size_t>& skip,
                      const Simulator::Progress& progress) {
    const EffectTable& table = simulator.effects();
    Signatures out;
    std::vector<Assumption> others;
    const bool expensive = !simulator.mechanics().first_order({}, {}, {});
    for (std::size_t e = 0; e < table.size(); ++e) {
        if (!table[e].applicable() || std::find(skip.begin(), skip.end(), e) != skip.end()) continue;
        const bool thin = expensive && !table[e].sensor && table[e].info.num_candidates > kFewCandidates;
        const std::int32_t stride = thin ? table[e].info.num_candidates / kFewCandidates : 1;
        for (std::int32_t c = 0; c < table[e].info.num_candidates; c += stride) {
            const ActiveEffect full = table.candidate(e, static_cast<std::size_t>(c));
            const std::size_t amplitudes = table.num_amplitudes(e);
            out.candidates.push_back({e, static_cast<std::size_t>(c), static_cast<Eigen::Index>(others.size()),
                                      static_cast<Eigen::Index>(amplitudes)});
            for (std::size_t a = 0; a < amplitudes; ++a) {
                Assumption other = base.at;
                other.effects.push_back(table.single(full, a));
                others.push_back(std::move(other));
            }
        }
    }
    out.changes = simulator.responses(others, progress);
    return out;
}

Screening screen(const Simulator& simulator, const Signatures& signatures, const Whitener& whitener,
                 const ErrorFloor& all_frames, const Fit& base, const Calibration& calibration,
                 std::size_t num_frames) {
    const EffectTable& table = simulator.effects();
    const auto end = static_cast<Eigen::Index>(3 * simulator.num_markers() * num_frames);
    const auto used = std::lower_bound(whitener.rows().begin(), whitener.rows().end(), end) - whitener.rows().begin();
    const double share = static_cast<double>(used) / static_cast<double>(whitener.size());
    const ErrorFloor floor =
        ErrorFloor{share * all_frames.noise, share * all_frames.model}.with_noise(simulator.noise_factor(base.at));
    const Residual residual(whitener(signatures.changes).topRows(used), base, used);
    const double noise_factor = stated_noise_factor(base.residual, whitener, all_frames.noise, simulator.num_markers());

    Screening out;
    out.cost_null = residual.cost_null;
    for (std::size_t e = 0; e < table.size(); ++e) {
        EffectScreening effect;
        effect.entry = e;
        std::vector<double> scores;
        double best = -std::numeric_limits<double>::infinity();
        for (const auto& c : signatures.candidates) {
            if (c.entry != e) continue;
            const ActiveEffect full = table.candidate(e, c.index);
            Assumption other = base.at;
            other.effects.push_back(full);
            const bool noise = simulator.noise_factor(other) != simulator.noise_factor(base.at);
            const Weighed w =
                noise ? residual.as_noise(floor, noise_factor, c.count) : residual.weigh(table[e], full, c);
            if (!noise && w.S.trace() > effect.visibility) {
                effect.visibility = w.S.trace();
                effect.signature = residual.G.middleCols(c.first, c.count);
            }
            const double tempering = calibration.nu / floor.above(w.cost);
            const AmplitudePrice price = amplitude_price({w.a}, tempering * w.S, counted_amplitudes(c.count));
            const double score = -0.5 * calibration.nu * std::log(floor.above(w.cost) / floor.above(out.cost_null)) -
                                 price.tail - price.occam;
            scores.push_back(score);
            const double explained = 1.0 - w.cost / out.cost_null;
            const ActiveEffect start = scaled(table[e], full, amplitudes_of(table[e]), w.a);
            take_place(table, e, {{}, score, explained, start, c.index}, effect.places);
            if (score > best) {
                best = score;
                effect.explained = explained;
                effect.start = start;
                effect.candidate = c.index;
            }
        }
        if (scores.empty()) continue;
        effect.num_candidates = scores.size();
        effect.score = log_mean_exp(scores);
        effect.search_cost = best - effect.score;
        out.effects.push_back(std::move(effect));
    }
    std::sort(out.effects.begin(), out.effects.end(), [](const auto& a, const auto& b) { return a.score > b.score; });
    return out;
}

}  // namespace teres
