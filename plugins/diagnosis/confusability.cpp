#include "plugins/diagnosis/confusability.h"

#include <algorithm>
#include <array>

namespace teres {
namespace {

Signature together(const Signature& a, const Signature& b) {
    Signature both{a.entry, Eigen::MatrixXd(a.G.rows(), a.G.cols() + b.G.cols()), {}};
    both.W = both.G;
    both.G << a.G, b.G;
    both.W << a.W, b.W;
    return both;
}

}  // namespace

double share_reproduced(const Signature& c, const Signature& d) {
    if (c.visibility() <= 0.0) return 0.0;
    const Eigen::MatrixXd S_cd = c.G.transpose() * d.W;
    const Eigen::MatrixXd S_dd = d.G.transpose() * d.W + Eigen::MatrixXd::Identity(d.G.cols(), d.G.cols());
    return std::clamp((S_cd * S_dd.ldlt().solve(S_cd.transpose())).trace() / c.visibility(), 0.0, 1.0);
}

Confusability confusability(const Screening& screening, const EffectTable& effects, const Eigen::MatrixXd& nuisance) {
    const Eigen::MatrixXd H =
        Eigen::MatrixXd::Identity(nuisance.cols(), nuisance.cols()) + nuisance.transpose() * nuisance;
    const Eigen::LLT<Eigen::MatrixXd> solver(H);
    std::vector<Signature> of;
    for (const EffectScreening& effect : screening.effects) {
        const Eigen::MatrixXd& G = effect.signature;
        if (G.cols() > 0) of.push_back({effect.entry, G, G - nuisance * solver.solve(nuisance.transpose() * G)});
    }
    std::sort(of.begin(), of.end(), [](const Signature& a, const Signature& b) { return a.entry < b.entry; });
    const auto count = static_cast<Eigen::Index>(of.size());
    Confusability out;
    out.overlap = Eigen::MatrixXd::Identity(count, count);
    for (std::size_t c = 0; c < of.size(); ++c) {
        out.entries.push_back(of[c].entry);
        out.visibility.push_back(of[c].visibility());
        for (std::size_t d = 0; d < of.size(); ++d)
            if (c != d)
                out.overlap(static_cast<Eigen::Index>(c), static_cast<Eigen::Index>(d)) =
                    share_reproduced(of[c], of[d]);
    }
    std::erase_if(of, [&](const Signature& s) { return !effects[s.entry].sensor; });
    out.sensors = std::move(of);
    return out;
}

std::vector<std::array<std::size_t, 2>> Confusability::pairs_instead(std::size_t entry,
                                                                     const Eigen::VectorXd& amplitudes,
                                                                     const Left& nominal, const Left& left,
                                                                     const ErrorFloor& floor,
                                                                     const Calibration& calibration) const {
    std::vector<std::array<std::size_t, 2>> list;
    const auto own = std::find_if(sensors.begin(), sensors.end(), [&](const Signature& s) { return s.entry == entry; });
    if (own == sensors.end()) return list;
    const Signature named{entry, own->G * amplitudes, own->W * amplitudes};
    const double explained = std::max(0.0, nominal.cost - left.cost);
    const auto same = [&](const Signature& other) {
        const Left instead{left.cost + (1.0 - share_reproduced(named, other)) * explained, left.beside};
        return 0.5 * calibration.nu * (floor.log_above(instead) - floor.log_above(left)) < calibration.same_evidence;
    };
    std::vector<const Signature*> others;
    for (const Signature& other : sensors)
        if (other.entry != entry && !same(other)) others.push_back(&other);
    for (std::size_t a = 0; a < others.size(); ++a)
        for (std::size_t b = a + 1; b < others.size(); ++b)
            if (same(together(*others[a], *others[b]))) list.push_back({others[a]->entry, others[b]->entry});
    return list;
}

std::vector<std::size_t> Confusability::rivals(std::size_t entry, double bound) const {
    std::vector<std::size_t> list;
    const auto at = std::find(entries.begin(), entries.end(), entry);
    if (at == entries.end()) return list;
    const Eigen::Index c = at - entries.begin();
    for (std::size_t d = 0; d < entries.size(); ++d)
        if (entries[d] != entry && overlap(c, static_cast<Eigen::Index>(d)) >= bound) list.push_back(entries[d]);
    return list;
}

std::string separating_experiment(const std::string& a, const std::string& b) {
    struct Advice {
        const char *first, *second, *text;  // second null: makes `first` visible
    };
    static constexpr std::array<Advice, 44> kAdvice{{
        {"registration", "gravity",
         "record a second table angle: gravity turns with the table, a registration error does not"},
        {"registration", "pressure", "change the insufflation by 2 mmHg: only pressure follows"},
        {"registration", "depth_scale", "record from a second camera distance, or with a scale bar in view"},
        {"registration", "moving_attachment", "record one still second (apnoea): a registration error stays"},
        {"gravity", "pressure", "change the insufflation by 2 mmHg, or the table angle: each moves one of the two"},
        {"stiffness", "viscoelasticity", "repeat one load at half the speed: only a viscous body answers differently"},
        {"stiffness", "material_law", "repeat one load with half the force: a stiffening law is not proportional"},
        {"stiffness", "load_scale",
         "repeat with another tool or a force sensor: a mis-measured load stays with its tool"},
        {"stiffness", "inclusion",
         "press at a second place far from the first: an inclusion softens or stiffens one of them only"},
        {"stiffness", "damping", "hold a load still: damping vanishes, the modulus does not"},
        {"stiffness", "inertia",
         "compare the static shape with the frequency: a missing mass leaves the static shape unchanged"},
        {"viscoelasticity", "material_law", "repeat one load at half the speed and with half the force"},
        {"viscoelasticity", "latency", "hold a load still for some seconds: a late stamp shows no creep"},
        {"viscoelasticity", "damping", "hold a load still for some seconds: creep goes on, damping does not"},
        {"inclusion", "cut", "look before and after the suspected instant: an inclusion was always there"},
        {"contact", "extra_attachment",
         "push the place in both directions: contact only resists pushing, an attachment only pulling"},
        {"ligament_slack", "ligament_tear", "pull on that ligament once before and once after the suspected instant"},
        {"load_scale", "unknown_load", "move one tool at a time: a mis-measured load stops with its tool"},
        {"load_scale", "extra_attachment", "press beside the suspected place with another tool"},
        {"load_scale", "inclusion", "press at a second place: a mis-measured load stays with its tool"},
        {"clamp_compliance", "registration", "track a marker near the support: a compliant support moves it"},
        {"clamp_compliance", "stiffness",
         "press near the support and far from it: a compliant support turns the body as a whole"},
        {"camera_drift", "registration", "track a marker on bone or table: drift grows with time"},
        {"unknown_load", "registration", "track the instruments: an unknown load comes and goes"},
        {"stiffness", nullptr, "press harder, at two places"},
        {"inclusion", nullptr, "press beside the suspected place"},
        {"viscoelasticity", nullptr, "step and hold a load, at two speeds"},
        {"material_law", nullptr, "press with two amplitudes of the same load"},
        {"compressibility", nullptr, "press with a broad tool and track markers beside it"},
        {"cut", nullptr, "load the body on both sides of the suspected cut, before and after"},
        {"extra_attachment", nullptr, "pull beside the suspected attachment, away from it"},
        {"ligament_slack", nullptr, "pull on that ligament once"},
        {"ligament_tear", nullptr, "pull on that ligament once before and once after"},
        {"clamp_compliance", nullptr, "track a landmark near the support (ultrasound)"},
        {"contact", nullptr, "push the surface towards the suspected neighbour and back"},
        {"gravity", nullptr, "record a second table angle"},
        {"pressure", nullptr, "change the insufflation by 2 mmHg"},
        {"load_scale", nullptr, "move one tool at a time, with a second amplitude"},
        {"cardiac", nullptr, "record at 4 Hz or more, with the ECG"},
        {"moving_attachment", nullptr, "record at least three breaths, then one apnoea"},
        {"depth_scale", nullptr, "record from a second camera distance"},
        {"lens_distortion", nullptr, "move the markers towards the image border, or use a calibration board"},
        {"latency", nullptr, "move fast once, or flash a light that both clocks see"},
        {"noise", nullptr, "record one still second"},
    }};
    for (const Advice& advice : kAdvice) {
        if (b.empty() && advice.second == nullptr && a == advice.first) return advice.text;
        if (b.empty() || advice.second == nullptr) continue;
        if ((a == advice.first && b == advice.second) || (a == advice.second && b == advice.first)) return advice.text;
    }
    if (b.empty()) return "load the body in another direction and with another amplitude";
    const std::string one = separating_experiment(a, ""), other = separating_experiment(b, "");
    return one == other ? one : one + "; " + other;
}

}  // namespace teres
