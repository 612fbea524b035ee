#include "plugins/diagnosis/search_further.h"

#include "plugins/diagnosis/form_columns.h"
#include "plugins/diagnosis/search.h"

namespace teres {
namespace {

constexpr int kIterations = 6;
constexpr double kFormShare = 0.2;  // standard deviation of a form, share of the effect's motion

// The whitener in use, with columns for what the known effects may get wrong of their form.
Whitener looser_whitener(Problem& problem, const Fit& known) {
    if (problem.simulator.mechanics().dynamic()) return problem.whitener;
    const Eigen::MatrixXd forms = form_columns(problem.simulator, known.at, known.trajectory, kFormShare);
    Eigen::MatrixXd columns = problem.discrepancy.columns;
    columns.conservativeResize(Eigen::NoChange, columns.cols() + forms.cols());
    columns.rightCols(forms.cols()) = forms;
    return tempered_whitener(problem.whitener.rows(), problem.whitener.inverse_sigma().cwiseInverse(), columns,
                             problem.options.calibration);
}

// One effect more than `known`. Nothing if looser forms of that explain what is left.
std::vector<Cause> search_on_top(Problem& problem, const Fit& nominal, const Cause& known) {
    Base base{known, looser_whitener(problem, known.fit), known.fit, 0.0};
    complete(problem.simulator, base.looser, problem.recording.observed, base.fit);
    if (!base.fit.usable) return {};
    base.misfit = misfit_under(problem, base.looser, base.fit, nominal.u.size());
    const double noise = problem.simulator.noise_factor(known.fit.at);
    if (base.fit.cost / (noise * noise) < problem.floor.total() + form_error(problem, nominal, known)) return {};
    Screening screening;
    return search(problem, nominal, &base, screening);
}

// The last effect of a larger cause as a cause of its own.
Cause added_alone(Problem& problem, const Fit& nominal, const Cause& larger, double search_cost_before) {
    EffectScreening added;
    added.entry = larger.entries.back();
    added.start = larger.fit.at.effects.back();
    added.search_cost = larger.search_cost - search_cost_before;
    Cause alone = refit(problem, nominal, nullptr, added, kIterations);
    score(problem, nominal, nullptr, alone);
    return alone;
}

}  // namespace

bool search_further(Problem& problem, const Fit& nominal, std::vector<Cause>& causes) {
    const double best_before = causes.front().score;
    // Where no single effect pays, the pair begins with the one that explains most.
    Cause base = causes.front();
    if (best_before < problem.options.calibration.none_bonus)
        for (const Cause& cause : causes)
            if (cause.fit.usable && (!base.fit.usable || cause.misfit < base.misfit)) base = cause;
    if (!base.fit.usable) return false;
    const auto add = [&](std::vector<Cause> larger) {
        for (Cause& cause : larger) keep_better(causes, std::move(cause));
    };
    std::vector<Cause> larger = search_on_top(problem, nominal, base);
    if (!larger.empty() && larger.front().fit.usable) {
        const Cause best = larger.front();
        add(std::move(larger));
        const bool enough = best.fit.cost < problem.floor.total();
        if (base.entries.size() == 1 && !enough && !problem.simulator.mechanics().dynamic()) {  // the exchange
            const Cause* fitted = fitted_alone(causes, best.entries.back());
            const Cause alone = fitted != nullptr ? *fitted : added_alone(problem, nominal, best, base.search_cost);
            if (alone.fit.usable) {
                add(search_on_top(problem, nominal, alone));
                keep_better(causes, alone);
            }
        }
    }
    sort_by_score(causes);
    return causes.front().score > best_before;
}

}  // namespace teres
