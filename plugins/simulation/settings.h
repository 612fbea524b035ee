// Settings of the unit `simulation`: default, unit, range and help of each, in one place.
#pragma once

#include <string>
#include <vector>

#include "core/plugin_sdk.h"
#include "plugins/simulation/scene_player.h"

namespace teres {

struct SimulationSettings {
    std::string case_folder;
    std::string law = "case";
    std::string element = "nodal_blend";
    double shear_blend = 0.5;
    std::string boundary = "estimated";
    double fixed_probability = 0.5;
    std::string ligament_model = "auto";
    int num_groups = 8;
    double min_probability = 0.02;
    double ligament_log_stdev = 1.2;
    double attached_share = 0.2;
    double band_shear_ratio = 0.0;
    double spring_g1 = 1.0, spring_g2 = 0.0, spring_g3 = 1.0;
    std::string integrator = "auto";
    double spectral_radius = 0.9;
    double relative_residual = 1e-4;
    int max_iterations = 60;
    int refactorise_after = 12;
    int renew_after = 9;
    int renewal_steps = 6;
    int newton_budget = 6;
    bool plain_newton = false;
    int max_lanes = 40;
    int threads = 2;
    std::string effects;
    bool trajectories = false;
    double trajectory_residual = 1e-3;
    double max_step_s = 0.0025;
    int trajectory_frames = 0;

    template <class V>
    void visit(V& field) {
        field("case", case_folder, "", "case folder (teres-case-1); empty: that of [service]");
        field("law", law, "case|stvk|corotational|neo_hookean|ogden",
              "material of the body; `case` takes the one that case.json names");
        field("element", element, "nodal_blend|nodal_volume|linear|quadratic",
              "nodal_blend: linear tetrahedra with nodal strain averaging (does not lock); linear: plain "
              "(locks); quadratic: 10-node");
        field("shear_blend", shear_blend, {0.0, 1.0},
              "nodal_blend: share of the shear energy on elements, the rest on nodes");
        field("boundary", boundary, "estimated|atlas_fixed",
              "ligament groups as unknowns, or the atlas region held fixed");
        field("fixed_probability", fixed_probability, {0.0, 1.0},
              "atlas_fixed: nodes at or above this probability are held");
        field("ligament_model", ligament_model, "auto|band|cubic_springs",
              "auto follows ligament.law of the case: neo_hookean is a band, cubic_spring tension-only "
              "springs");
        field("num_groups", num_groups, {1, 64}, "ligament regions that share a stiffness (unknowns)");
        field("min_probability", min_probability, {0.0, 1.0}, "atlas nodes below this are left out");
        field("ligament_log_stdev", ligament_log_stdev, {0.05, 5.0}, "prior standard deviation of ln(stiffness)");
        field("attached_share", attached_share, {0.001, 1.0},
              "a group counts as attached above this share of the full stiffness");
        field("band_shear_ratio", band_shear_ratio, {0.0, 2.0},
              "tangential over normal stiffness of a band; 0: from its proportions");
        field("spring_g1", spring_g1, {0.0, 100.0},
              "cubic springs: tension over E A / L is g1 e + g2 e^2 + g3 e^3 at strain e (teres calibrate-springs)");
        field("spring_g2", spring_g2, {-100.0, 100.0}, "the coefficient of e^2");
        field("spring_g3", spring_g3, {-100.0, 1000.0}, "the coefficient of e^3");
        field("integrator", integrator, "auto|quasi_static|implicit_euler|generalised_alpha",
              "auto: as case.json says");
        field("spectral_radius", spectral_radius, {0.0, 1.0}, "generalised alpha: 1 no numerical damping, 0 strongest");
        field("relative_residual", relative_residual, {1e-12, 1e-2},
              "a step ends when |residual| <= this * |applied force|");
        field("max_iterations", max_iterations, {1, 1000}, "quasi-Newton iterations before plain Newton takes over");
        field("refactorise_after", refactorise_after, {1, 1000},
              "with inertia, or without renewals in the background: a step with more iterations has the tangent "
              "factorised anew before the next one");
        field("renew_after", renew_after, {0, 1000},
              "a step with more iterations has the tangent factorised anew in the background");
        field("renewal_steps", renewal_steps, {0, 1000},
              "steps after which a factorisation from the background is taken over (a fixed number: same "
              "input, same "
              "bits); 0: none in the background");
        field(
            "newton_budget", newton_budget, {0, 100000},
            "steps of the plain Newton (a factorisation each) that all lanes of a step may take together, so that a "
            "model far from the truth cannot hold up the loop; what has not converged then is counted; 0: any number");
        field("plain_newton", plain_newton, "every lane alone with full Newton: slow reference path");
        field("threads", threads, {1, 64}, "threads that share a step; the same number gives the same bits");
        field("max_lanes", max_lanes, {1, 128}, "largest batch (sigma points) that workspaces are made for");
        field("effects", effects, "",
              "mechanical effects whose parameters are unknowns beside the ligament groups, e.g. "
              "\"stiffness, gravity\" (teres effects); sigma points are then simulated one after the other");
        field("trajectories", trajectories,
              "offer whole recordings under hypotheses too (teres.trajectory_model); memory of 0.1-0.5 GB");
        field("trajectory_residual", trajectory_residual, {1e-12, 1e-2},
              "trajectories: a step ends when |residual| <= this * |applied force|");
        field("max_step_s", max_step_s, {1e-5, 1.0},
              "dynamic cases: longest time step; frames further apart are walked in parts");
        field("trajectory_frames", trajectory_frames, {0, 1000000},
              "trajectories: only so many frames from the first; 0: all");
    }

    /// The words of `effects`.
    std::vector<std::string> effect_ids() const {
        std::vector<std::string> ids(1);
        for (const char c : effects)
            if (c == ',' || c == ' ')
                ids.emplace_back();
            else
                ids.back() += c;
        std::erase(ids, "");
        return ids;
    }

    PlayerSettings player_settings() const {
        PlayerSettings p;
        p.model = model_settings();
        p.num_frames = trajectory_frames;
        p.model.equilibrium.relative_residual = trajectory_residual;
        p.model.equilibrium.min_iterations = 2;
        p.model.threads = 1;  // one lane: another thread solves other frames or other hypotheses
        p.model.equilibrium.newton_budget = 0;
        p.model.equilibrium.max_newton_iterations = 10;  // a frame that needs more is given up
        return p;
    }

    CaseModelSettings model_settings() const {
        CaseModelSettings m;
        m.element = element == "linear"         ? ElementType::kLinear
                    : element == "nodal_volume" ? ElementType::kNodalVolume
                    : element == "quadratic"    ? ElementType::kQuadratic
                                                : ElementType::kNodalBlend;
        m.shear_blend = shear_blend;
        m.law = law;
        m.boundary = boundary;
        m.fixed_probability = fixed_probability;
        m.ligament = {num_groups,
                      min_probability,
                      ligament_log_stdev,
                      attached_share,
                      band_shear_ratio,
                      ligament_model,
                      {spring_g1, spring_g2, spring_g3}};
        m.equilibrium.relative_residual = relative_residual;
        m.equilibrium.max_iterations = max_iterations;
        m.equilibrium.refactorise_after = refactorise_after;
        m.equilibrium.renew_after = renew_after;
        m.equilibrium.renewal_steps = renewal_steps;
        m.equilibrium.newton_budget = plain_newton ? 0 : newton_budget;
        m.equilibrium.plain_newton = plain_newton;
        m.integrator = integrator;
        m.spectral_radius = spectral_radius;
        m.max_step_s = max_step_s;
        m.max_lanes = max_lanes;
        m.threads = threads;
        return m;
    }
};

}  // namespace teres
