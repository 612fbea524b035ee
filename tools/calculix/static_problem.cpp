#include "tools/calculix/static_problem.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <utility>

namespace teres::calculix {
namespace {

using Edge = std::pair<std::int32_t, std::int32_t>;

// Order of the mid-edge nodes of C3D10.
constexpr std::array<std::array<int, 2>, 6> kEdges{{{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}}};

Edge edge(std::int32_t a, std::int32_t b) {
    return {std::min(a, b), std::max(a, b)};
}

std::map<Edge, std::int32_t> mid_edge_nodes(const CalculixProblem& problem) {
    std::map<Edge, std::int32_t> mid;
    for (const auto& tet : problem.tets) {
        for (const auto& [i, j] : kEdges) mid.try_emplace(edge(tet[i], tet[j]), 0);
    }
    auto next = static_cast<std::int32_t>(problem.nodes.size());
    for (auto& [ends, id] : mid) id = next++;
    return mid;
}

Status check(const CalculixProblem& problem) {
    const auto num_nodes = static_cast<std::int32_t>(problem.nodes.size());
    const auto in_range = [&](std::int32_t id) { return id >= 0 && id < num_nodes; };
    for (std::size_t e = 0; e < problem.tets.size(); ++e) {
        if (!std::all_of(problem.tets[e].begin(), problem.tets[e].end(), in_range)) {
            return invalid_input("tetrahedron " + std::to_string(e) + ": node id outside [0, " +
                                 std::to_string(num_nodes) + ")");
        }
    }
    if (problem.tets.empty()) return invalid_input("no tetrahedra");
    if (problem.clamped.empty() && problem.rollers.empty()) {
        return invalid_input("no node is held: the static problem has no unique solution");
    }
    for (const Roller& roller : problem.rollers) {
        if (!in_range(roller.node_id) || roller.axis < 0 || roller.axis > 2) {
            return invalid_input("roller on node " + std::to_string(roller.node_id) + ", axis " +
                                 std::to_string(roller.axis) + " does not exist");
        }
    }
    for (const std::int32_t id : problem.clamped) {
        if (!in_range(id)) return invalid_input("clamped node " + std::to_string(id) + " does not exist");
    }
    for (const NodeForce& force : problem.node_forces) {
        if (!in_range(force.node_id)) {
            return invalid_input("loaded node " + std::to_string(force.node_id) + " does not exist");
        }
    }
    const CalculixMaterial& m = problem.material;
    if (!(m.youngs_modulus_pa > 0.0)) {
        return invalid_input("youngs_modulus_pa = " + number(m.youngs_modulus_pa) + ", must be > 0");
    }
    if (!(m.poissons_ratio > -1.0 && m.poissons_ratio < 0.5)) {
        return invalid_input("poissons_ratio = " + number(m.poissons_ratio) + ", must be in (-1, 0.5)");
    }
    if (problem.gravity_m_s2 != Point{} && !(m.density_kg_m3 > 0.0)) {
        return invalid_input("gravity needs density_kg_m3 > 0, is " + number(m.density_kg_m3));
    }
    if (problem.increments < 1)
        return invalid_input("increments = " + std::to_string(problem.increments) + ", must be >= 1");
    return {};
}

double area(const CalculixProblem& problem, const std::array<std::int32_t, 3>& face) {
    const Point &a = problem.nodes[face[0]], &b = problem.nodes[face[1]], &c = problem.nodes[face[2]];
    Point n{};
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        n[i] = (b[j] - a[j]) * (c[k] - a[k]) - (b[k] - a[k]) * (c[j] - a[j]);
    }
    return 0.5 * std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
}

// Consistent nodal forces: a third of a face's force on each corner (linear) or on each mid-edge node
// (quadratic).
Result<std::map<std::int32_t, Point>> nodal_loads(const CalculixProblem& problem,
                                                  const std::map<Edge, std::int32_t>& mid) {
    std::map<std::int32_t, Point> loads;
    const auto add = [&](std::int32_t node, const Point& force, double share) {
        for (int i = 0; i < 3; ++i) loads[node][i] += share * force[i];
    };
    for (const NodeForce& force : problem.node_forces) add(force.node_id, force.force_n, 1.0);
    for (const FaceTraction& load : problem.face_tractions) {
        for (int i = 0; i < 3; ++i) {
            const auto found = mid.find(edge(load.face[i], load.face[(i + 1) % 3]));
            if (found == mid.end()) {
                return invalid_input("loaded face " + std::to_string(load.face[0]) + " " +
                                     std::to_string(load.face[1]) + " " + std::to_string(load.face[2]) +
                                     " is not a face of the mesh");
            }
            add(problem.quadratic ? found->second : load.face[i], load.traction_pa, area(problem, load.face) / 3.0);
        }
    }
    return loads;
}

// Sets HELD1..3 (the nodes whose displacement along axis 1..3 is zero), HELD (their union) and the boundary
// condition.
std::string held_cards(const CalculixProblem& problem, const std::map<Edge, std::int32_t>& mid) {
    std::array<std::vector<char>, 3> held;
    for (auto& axis : held) {
        axis.assign(problem.nodes.size(), 0);
        for (const std::int32_t id : problem.clamped) axis[id] = 1;
    }
    for (const Roller& roller : problem.rollers) held[roller.axis][roller.node_id] = 1;
    std::string text, conditions, all = "*NSET, NSET=HELD\n";
    for (int axis = 0; axis < 3; ++axis) {
        const std::string name = "HELD" + std::to_string(axis + 1);
        std::string ids;
        for (std::size_t i = 0; i < problem.nodes.size(); ++i) {
            if (held[axis][i] != 0) ids += std::to_string(i + 1) + ",\n";
        }
        for (const auto& [ends, id] : mid) {
            if (problem.quadratic && held[axis][ends.first] != 0 && held[axis][ends.second] != 0) {
                ids += std::to_string(id + 1) + ",\n";
            }
        }
        if (ids.empty()) continue;
        text += "*NSET, NSET=" + name + "\n" + ids;
        all += name + ",\n";
        conditions += name + ", " + std::to_string(axis + 1) + "\n";
    }
    return text + all + "*BOUNDARY\n" + conditions;
}

}  // namespace

Result<std::string> calculix_input(const CalculixProblem& problem) {
    TERES_TRY(check(problem));
    const std::map<Edge, std::int32_t> mid = mid_edge_nodes(problem);
    TERES_TRY_ASSIGN(const auto loads, nodal_loads(problem, mid));
    std::ostringstream out;
    out << "*NODE, NSET=ALL\n";
    const auto node_line = [&](std::size_t id, const Point& p) {
        out << id + 1 << ", " << number(p[0]) << ", " << number(p[1]) << ", " << number(p[2]) << "\n";
    };
    for (std::size_t i = 0; i < problem.nodes.size(); ++i) node_line(i, problem.nodes[i]);
    if (problem.quadratic) {
        for (const auto& [ends, id] : mid) {
            const Point &a = problem.nodes[ends.first], &b = problem.nodes[ends.second];
            node_line(id, {0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])});
        }
    }
    out << "*ELEMENT, TYPE=" << (problem.quadratic ? "C3D10" : "C3D4") << ", ELSET=BODY\n";
    for (std::size_t e = 0; e < problem.tets.size(); ++e) {
        const auto& tet = problem.tets[e];
        out << e + 1;
        for (const std::int32_t node : tet) out << ", " << node + 1;
        if (problem.quadratic) {
            for (const auto& [i, j] : kEdges) out << ", " << mid.at(edge(tet[i], tet[j])) + 1;
        }
        out << "\n";
    }
    out << "*NSET, NSET=CORNERS, GENERATE\n1, " << problem.nodes.size() << ", 1\n"
        << material_card(problem.material, "M", "BODY") << held_cards(problem, mid);
    out << "*STEP, INC=1000" << (problem.large_displacements ? ", NLGEOM" : "") << "\n*STATIC\n"
        << number(1.0 / problem.increments) << ", 1.0\n";
    if (problem.large_displacements) {
        out << "*CONTROLS, PARAMETERS=FIELD\n"
            << number(problem.residual) << ", " << number(problem.correction) << "\n";
    }
    if (!loads.empty()) out << "*CLOAD\n";
    for (const auto& [id, force] : loads) {
        for (int i = 0; i < 3; ++i) {
            if (force[i] != 0.0) out << id + 1 << ", " << i + 1 << ", " << number(force[i]) << "\n";
        }
    }
    const Point& g = problem.gravity_m_s2;
    const double magnitude = std::sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
    if (magnitude > 0.0) {
        out << "*DLOAD\nBODY, GRAV, " << number(magnitude) << ", " << number(g[0] / magnitude) << ", "
            << number(g[1] / magnitude) << ", " << number(g[2] / magnitude) << "\n";
    }
    out << "*NODE PRINT, NSET=CORNERS, FREQUENCY=1000\nU\n*NODE PRINT, NSET=HELD, FREQUENCY=1000\nRF\n*END "
           "STEP\n";
    return out.str();
}

Result<CalculixSolution> solve_with_calculix(const CalculixProblem& problem, const std::filesystem::path& scratch) {
    TERES_TRY_ASSIGN(const std::string input, calculix_input(problem));
    std::ofstream(scratch / "job.inp") << input;
    TERES_TRY_ASSIGN(const CalculixRun run, run_calculix(scratch, "job", problem.threads, 3600.0));
    TERES_TRY_ASSIGN(const auto moved, last_block(run.dat, "displacements"));
    TERES_TRY_ASSIGN(const auto reactions, last_block(run.dat, "forces"));
    CalculixSolution solution;
    solution.seconds = run.seconds;
    solution.num_nodes = problem.nodes.size() + (problem.quadratic ? mid_edge_nodes(problem).size() : 0);
    solution.displacement_m.assign(problem.nodes.size(), Point{});
    if (moved.size() != problem.nodes.size()) {
        return not_usable("ccx printed " + std::to_string(moved.size()) + " of " +
                          std::to_string(problem.nodes.size()) + " displacements");
    }
    for (const auto& [id, u] : moved) solution.displacement_m[id] = u;
    for (const auto& [id, f] : reactions) {
        for (int i = 0; i < 3; ++i) solution.reaction_n[i] += f[i];
    }
    return solution;
}

}  // namespace teres::calculix
