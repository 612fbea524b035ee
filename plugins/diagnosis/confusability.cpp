#include "plugins/diagnosis/confusability.h"

#include <algorithm>
#include <array>

namespace teres {

Confusability confusability(const Screening& screening, const Eigen::MatrixXd& nuisance) {
    std::vector<const EffectScreening*> effects;
    for (const auto& effect : screening.effects)
        if (effect.signature.cols() > 0) effects.push_back(&effect);
    std::sort(effects.begin(), effects.end(), [](const auto* a, const auto* b) { return a->entry < b->entry; });
    const Eigen::MatrixXd H =
        Eigen::MatrixXd::Identity(nuisance.cols(), nuisance.cols()) + nuisance.transpose() * nuisance;
    const Eigen::LLT<Eigen::MatrixXd> solver(H);
    const auto count = static_cast<Eigen::Index>(effects.size());
    Confusability out;
    out.overlap = Eigen::MatrixXd::Identity(count, count);
    std::vector<Eigen::MatrixXd> weighted;
    for (const auto* effect : effects) {
        const Eigen::MatrixXd& G = effect->signature;
        weighted.push_back(G - nuisance * solver.solve(nuisance.transpose() * G));
        out.entries.push_back(effect->entry);
        out.visibility.push_back((G.transpose() * weighted.back()).trace());
    }
    for (Eigen::Index c = 0; c < count; ++c)
        for (Eigen::Index d = 0; d < count; ++d) {
            const auto& Gc = effects[static_cast<std::size_t>(c)]->signature;
            const auto& Gd = effects[static_cast<std::size_t>(d)]->signature;
            const Eigen::MatrixXd& Wd = weighted[static_cast<std::size_t>(d)];
            if (c == d || out.visibility[static_cast<std::size_t>(c)] <= 0.0) continue;
            const Eigen::MatrixXd Scd = Gc.transpose() * Wd;
            const Eigen::MatrixXd Sdd = Gd.transpose() * Wd + Eigen::MatrixXd::Identity(Gd.cols(), Gd.cols());
            out.overlap(c, d) = std::clamp(
                (Scd * Sdd.ldlt().solve(Scd.transpose())).trace() / out.visibility[static_cast<std::size_t>(c)], 0.0,
                1.0);
        }
    return out;
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
