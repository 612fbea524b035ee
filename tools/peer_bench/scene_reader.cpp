#include "tools/peer_bench/scene_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/case/text_file.h"

namespace teres::peer {

namespace {

constexpr double kHuge = 1e300;

Result<SolidLaw> solid_law(const JsonObject& solid) {
    TERES_TRY_ASSIGN(const std::string text, solid.text({"law", "material", "model"}));
    const std::string law = plain(text);
    if (law.find("polar") != std::string::npos) return SolidLaw::kCorotationalPolar;
    if (law.find("corotation") != std::string::npos || law == "large") return SolidLaw::kCorotationalFirstEdge;
    if (law.find("stvk") != std::string::npos || law.find("venant") != std::string::npos) return SolidLaw::kStvk;
    return solid.error({"law", "material", "model"},
                       in_quotes(text) + " is not corotational_first_edge, corotational_polar or stvk");
}

// "E10" -> 10; nullopt without digits at the end.
std::optional<long> trailing_number(const std::string& name) {
    std::size_t at = name.size();
    while (at > 0 && std::isdigit(static_cast<unsigned char>(name[at - 1]))) --at;
    if (at == name.size() || name.size() - at > 6) return std::nullopt;
    return std::stol(name.substr(at));
}

Status read_solid(const JsonObject& solid, Scene& scene) {
    TERES_TRY_ASSIGN(scene.law, solid_law(solid));
    TERES_TRY_ASSIGN(scene.poissons_ratio,
                     solid.number({"poissons_ratio", "poisson_ratio", "nu"}, -0.999999, 0.499999));
    const JsonObject::Keys keys = {"youngs_modulus_pa", "youngs_modulus", "young_modulus_pa", "young_modulus"};
    const Json* modulus = solid.find(keys);
    if (modulus == nullptr) return solid.error(keys, "is missing");
    const auto add = [&](const std::string& name, const Json& value) -> Status {
        if (!value.is_number() || !(value.get<double>() > 0.0))
            return solid.error(keys, name + " is not a positive number: " + value.dump().substr(0, 60));
        scene.modulus_names.push_back(name);
        scene.modulus_pa.push_back(value.get<double>());
        return {};
    };
    if (modulus->is_number()) {
        TERES_TRY(add("E", *modulus));
        scene.modulus_names.clear();
    } else if (modulus->is_array() && !modulus->empty()) {
        for (std::size_t i = 0; i < modulus->size(); ++i) TERES_TRY(add(fmt::format("E{}", i + 1), (*modulus)[i]));
    } else if (modulus->is_object() && !modulus->empty()) {
        for (auto at = modulus->begin(); at != modulus->end(); ++at) TERES_TRY(add(at.key(), at.value()));
        // Names numbered without a gap go by number (a sorted file has E10 before E2), others in file order.
        std::vector<std::pair<long, std::size_t>> order;
        for (std::size_t i = 0; i < scene.modulus_names.size(); ++i)
            if (const auto number = trailing_number(scene.modulus_names[i])) order.emplace_back(*number, i);
        std::sort(order.begin(), order.end());
        bool numbered = order.size() == scene.modulus_names.size();
        for (std::size_t i = 1; numbered && i < order.size(); ++i) numbered = order[i].first == order[i - 1].first + 1;
        if (numbered) {
            const auto names = scene.modulus_names;
            const auto values = scene.modulus_pa;
            for (std::size_t i = 0; i < order.size(); ++i) {
                scene.modulus_names[i] = names[order[i].second];
                scene.modulus_pa[i] = values[order[i].second];
            }
        }
    } else {
        return solid.error(keys, "is neither a number, a list nor an object of numbers");
    }
    solid.report_unknown(scene.warnings);
    return {};
}

Status read_regions(const JsonObject& solid, Scene& scene) {
    const std::size_t moduli = scene.modulus_pa.size();
    scene.region.assign(scene.mesh.tets.size(), 0);
    if (moduli == 1 && scene.modulus_names.empty()) return {};
    if (scene.mesh.region.empty())
        return solid.error({"youngs_modulus_pa"},
                           std::to_string(moduli) + " moduli, but mesh.vtk has no cell scalar 'region'");
    for (std::size_t e = 0; e < scene.region.size(); ++e) {
        const auto region = scene.mesh.region[e];
        if (region < 1 || static_cast<std::size_t>(region) > moduli)
            return invalid_input((scene.folder / "mesh.vtk").string() + ": tetrahedron " + std::to_string(e) +
                                 " has region " + std::to_string(region) + ", which is not in [1, " +
                                 std::to_string(moduli) + "]");
        scene.region[e] = static_cast<std::size_t>(region) - 1;
    }
    return {};
}

Status read_mass(const JsonObject& mass, Scene& scene) {
    const auto nodes = static_cast<Eigen::Index>(scene.mesh.nodes.size());
    if (mass.has({"density_kg_m3", "density"})) {
        TERES_TRY_ASSIGN(const double density, mass.number({"density_kg_m3", "density"}, 1e-9, 1e9));
        scene.node_mass_kg = mass_from_density(scene.mesh, density);
    } else if (mass.has({"total_mass_kg", "total_kg", "total_mass", "total", "mass_kg"})) {
        TERES_TRY_ASSIGN(const double total,
                         mass.number({"total_mass_kg", "total_kg", "total_mass", "total", "mass_kg"}, 1e-12, 1e9));
        scene.node_mass_kg = Eigen::VectorXd::Constant(nodes, total / static_cast<double>(nodes));
    } else if (mass.has({"node_mass_kg", "per_node_kg", "mass_per_node_kg"})) {
        TERES_TRY_ASSIGN(const double each,
                         mass.number({"node_mass_kg", "per_node_kg", "mass_per_node_kg"}, 1e-12, 1e9));
        scene.node_mass_kg = Eigen::VectorXd::Constant(nodes, each);
    } else {
        return invalid_input(mass.where() + ": neither density_kg_m3, total_mass_kg nor node_mass_kg");
    }
    mass.report_unknown(scene.warnings);
    return {};
}

Result<Integrator> integrator(const JsonObject& run) {
    const JsonObject::Keys keys = {"integrator", "time_integrator", "time_integration", "solver"};
    TERES_TRY_ASSIGN(const std::string text, run.text(keys));
    const std::string name = plain(text);
    if (name.find("static") != std::string::npos || name.find("newton") != std::string::npos)
        return Integrator::kStatic;
    if (name.find("midpoint") != std::string::npos || name.find("symplectic") != std::string::npos)
        return Integrator::kImplicitMidpoint;
    if (name.find("euler") != std::string::npos && name.find("explicit") == std::string::npos)
        return Integrator::kImplicitEuler;
    return run.error(keys, in_quotes(text) + " is not implicit_euler, implicit_midpoint or static");
}

// Newton and linear solver settings, looked up in the run first, then in the scene ("static", "solver").
Status read_solver(const std::vector<const JsonObject*>& places, RunSettings& run, std::vector<std::string>& warnings) {
    const JsonObject::Keys newton = {"newton_iterations", "newton_steps", "max_newton_iterations",
                                     "newton_max_iterations"};
    const JsonObject::Keys cg = {"cg_iterations", "cg_max_iterations", "max_cg_iterations",
                                 "conjugate_gradient_iterations"};
    const JsonObject::Keys linear = {"linear_solver"};
    const auto holder = [&](JsonObject::Keys keys) -> const JsonObject* {
        for (const auto* place : places)
            if (place->has(keys)) return place;
        return nullptr;
    };
    const bool is_static = run.integrator == Integrator::kStatic;
    bool use_cg = is_static;  // the peer's static runs use CG, its implicit steps a direct solver
    if (const auto* at = holder(linear); at != nullptr) {
        const Json* value = at->find(linear);
        const bool nested = value->is_object();
        TERES_TRY_ASSIGN(const JsonObject solver, nested ? at->object(linear) : Result<JsonObject>(*at));
        const JsonObject::Keys type_keys = {"type", "name", "method", "linear_solver"};
        TERES_TRY_ASSIGN(const std::string text, solver.text(type_keys));
        const std::string name = plain(text);
        if (name.find("cg") != std::string::npos || name.find("conjugategradient") != std::string::npos)
            use_cg = true;
        else if (name.find("ldl") != std::string::npos || name.find("direct") != std::string::npos ||
                 name.find("cholesky") != std::string::npos || name.find("lu") != std::string::npos)
            use_cg = false;
        else
            return solver.error(type_keys, in_quotes(text) + " is neither a conjugate gradient nor a direct solver");
        if (nested) {
            TERES_TRY_ASSIGN(run.cg_iterations,
                             solver.integer_or({"iterations", "max_iterations", "cg_iterations"}, 1, 1000000, 100));
            TERES_TRY_ASSIGN(run.cg_tolerance, solver.number_or({"tolerance", "cg_tolerance"}, 0.0, 1.0, 1e-20));
            solver.report_unknown(warnings);
        }
    }
    if (const auto* at = holder(newton); at != nullptr) {
        TERES_TRY_ASSIGN(run.equilibrium.newton_iterations, at->integer(newton, 1, 10000));
    } else if (is_static) {
        warnings.push_back("no newton_iterations given: 3, as PHYSICS_AND_FILTER.md section 5 says");
    }
    const JsonObject::Keys residual = {"residual_tolerance_n", "residual_tolerance", "force_tolerance",
                                       "newton_residual_tolerance"};
    const JsonObject::Keys correction = {"correction_tolerance_m", "correction_tolerance",
                                         "newton_correction_tolerance"};
    if (const auto* at = holder(residual); at != nullptr) {
        TERES_TRY_ASSIGN(run.equilibrium.residual_tolerance_n, at->number(residual, 0.0, kHuge));
    }
    if (const auto* at = holder(correction); at != nullptr) {
        TERES_TRY_ASSIGN(run.equilibrium.correction_tolerance_m, at->number(correction, 0.0, kHuge));
    }
    if (const auto* at = holder(cg); at != nullptr) {
        TERES_TRY_ASSIGN(run.cg_iterations, at->integer(cg, 1, 1000000));
        use_cg = true;
    } else if (use_cg && run.cg_iterations == 0) {
        run.cg_iterations = 100;
        warnings.push_back("no cg_iterations given: 100, as PHYSICS_AND_FILTER.md section 5 says");
    }
    if (const auto* at = holder({"cg_tolerance"}); at != nullptr) {
        TERES_TRY_ASSIGN(run.cg_tolerance, at->number({"cg_tolerance"}, 0.0, 1.0));
    } else if (use_cg && run.cg_tolerance == 0.0) {
        run.cg_tolerance = 1e-20;
    }
    if (!use_cg) run.cg_iterations = 0;
    run.equilibrium.cg_iterations = run.cg_iterations;
    run.equilibrium.cg_tolerance = run.cg_tolerance;
    return {};
}

// What generator and filter share, each of which may override the scene.
Status read_run(const JsonObject& run, const JsonObject& top, RunSettings& out, std::vector<std::string>& warnings) {
    TERES_TRY_ASSIGN(out.integrator, integrator(run));
    std::vector<const JsonObject*> places{&run};
    std::vector<JsonObject> nested;
    nested.reserve(4);
    for (const JsonObject* level : {&run, &top})
        for (const char* key : {"static", "newton", "static_solver"})
            if (const Json* value = level->find({key}); value != nullptr && value->is_object() && nested.size() < 4)
                nested.emplace_back(value, level->place({key}));
    for (const auto& object : nested) places.push_back(&object);
    places.push_back(&top);
    TERES_TRY(read_solver(places, out, warnings));
    for (const auto& object : nested) object.report_unknown(warnings);
    const auto number = [&](JsonObject::Keys keys, double min, double max, bool needed, double& value) -> Status {
        const JsonObject& at = run.has(keys) ? run : top;
        if (!needed && !at.has(keys)) return {};
        TERES_TRY_ASSIGN(value, at.number(keys, min, max));
        return {};
    };
    const bool dynamic = out.integrator != Integrator::kStatic;
    TERES_TRY(number({"dt_s", "dt", "time_step_s"}, 1e-9, 1e6, true, out.dt_s));
    TERES_TRY(number({"rayleigh_mass_1_s", "rayleigh_mass"}, 0.0, kHuge, dynamic, out.rayleigh_mass_1_s));
    TERES_TRY(number({"rayleigh_stiffness_s", "rayleigh_stiffness"}, 0.0, kHuge, dynamic, out.rayleigh_stiffness_s));
    TERES_TRY_ASSIGN(
        out.velocity_damping_1_s,
        run.number_or({"velocity_damping_1_s", "velocity_damping", "vdamping", "vdamping_1_s"}, 0.0, kHuge, 0.0));
    const JsonObject& gravity = run.has({"gravity_m_s2", "gravity"}) ? run : top;
    if (gravity.has({"gravity_m_s2", "gravity"})) {
        TERES_TRY_ASSIGN(out.gravity_m_s2, gravity.vector3({"gravity_m_s2", "gravity"}));
    }
    return {};
}

Status read_tool_use(const JsonObject& run, bool tool, RunSettings& out) {
    const JsonObject::Keys row = {"tool_row"};
    if (tool || run.has(row)) {
        TERES_TRY_ASSIGN(out.tool_row_offset, run.row_offset(row));
    }
    TERES_TRY_ASSIGN(out.tool_attached, run.step_ranges({"tool_attached_steps"}));
    return {};
}

Status read_events(const JsonObject& generator, Scene& scene) {
    TERES_TRY_ASSIGN(const auto events, generator.objects({"events"}));
    for (const auto& object : events) {
        Event event;
        TERES_TRY_ASSIGN(event.from_step, object.integer({"from_step", "step"}, 0, 1000000000));
        const JsonObject::Keys which = {"spring", "springs"};
        const Json* springs = object.find(which);
        if (springs == nullptr || !scene.springs) return object.error(which, "names no spring");
        const std::size_t count = scene.springs->springs.size();
        for (const Json& one : springs->is_array() ? *springs : Json::array({*springs})) {
            if (!one.is_number_unsigned() || one.get<std::size_t>() >= count)
                return object.error(which, one.dump().substr(0, 40) + " is not in [0, " + std::to_string(count) + ")");
            event.springs.push_back(one.get<std::size_t>());
        }
        if (object.has({"stiffness_n_per_m", "stiffness", "k"})) {
            TERES_TRY_ASSIGN(event.k[0], object.number({"stiffness_n_per_m", "stiffness", "k"}, 0.0, kHuge));
            if (scene.springs->num_coefficients > 1) {
                if (*event.k[0] != 0.0)
                    return object.error({"stiffness_n_per_m", "stiffness", "k"},
                                        "of a polynomial spring can only be 0 (cut)");
                event.k = {0.0, 0.0, 0.0};
            }
        }
        for (std::size_t i = 0; i < scene.springs->num_coefficients && i < 3; ++i) {
            const std::string with_unit = fmt::format("a{}_n", i + 1), bare = fmt::format("a{}", i + 1);
            const JsonObject::Keys keys = {with_unit.c_str(), bare.c_str()};
            if (object.has(keys)) {
                TERES_TRY_ASSIGN(event.k[i], object.number(keys, -kHuge, kHuge));
            }
        }
        if (!event.k[0] && !event.k[1] && !event.k[2])
            return object.error({"stiffness_n_per_m"}, "is missing: the event changes nothing");
        object.report_unknown(scene.warnings);
        scene.events.push_back(std::move(event));
    }
    return {};
}

Status read_recording(const JsonObject& generator, Scene& scene) {
    Recording& recording = scene.recording;
    TERES_TRY_ASSIGN(recording.first_record_step, generator.integer({"first_record_step"}, 0, 1000000));
    TERES_TRY_ASSIGN(recording.record_every_steps,
                     generator.integer_or({"record_every_steps", "record_every"}, 1, 1000000, 1));
    const JsonObject::Keys keys = {"records", "record"};
    TERES_TRY_ASSIGN(const std::string text, generator.text(keys));
    const std::string name = plain(text);
    if (name.find("point") != std::string::npos || name.find("mapped") != std::string::npos)
        recording.all_nodes = false;
    else if (name.find("node") != std::string::npos || name.find("mesh") != std::string::npos ||
             name.find("vert") != std::string::npos)
        recording.all_nodes = true;
    else
        return generator.error(keys, in_quotes(text) + " is neither points nor all_nodes");
    TERES_TRY_ASSIGN(recording.significant_digits, generator.integer_or({"significant_digits", "digits"}, 1, 17, 0));
    return {};
}

}  // namespace

Result<std::vector<NodeIndex>> nodes_of(const Scene& scene, const JsonObject& from, JsonObject::Keys keys) {
    TERES_TRY_ASSIGN(const auto names, from.texts(keys));
    std::vector<NodeIndex> nodes;
    for (const auto& name : names) {
        const auto group = scene.groups.find(name);
        if (group == scene.groups.end())
            return from.error(keys, in_quotes(name) + " is not a group of " + (scene.folder / "nodes.csv").string());
        nodes.insert(nodes.end(), group->second.begin(), group->second.end());
    }
    return nodes;
}

Result<Scene> read_scene(const std::filesystem::path& folder) {
    Scene scene;
    scene.folder = folder;
    const auto file = folder / "scene.json";
    TERES_TRY_ASSIGN(const Json json, JsonObject::parse_file(file));
    const JsonObject top(&json, file.string());
    TERES_TRY_ASSIGN(const std::string format, top.text({"format"}));
    if (format != "teres-peer-scene-1") return top.error({"format"}, in_quotes(format) + " is not teres-peer-scene-1");

    TERES_TRY_ASSIGN(const JsonObject solid, top.object({"solid", "body"}));
    TERES_TRY(read_solid(solid, scene));
    TERES_TRY(read_mesh_and_groups(scene));
    TERES_TRY(read_regions(solid, scene));
    TERES_TRY_ASSIGN(const JsonObject mass, top.object({"mass"}));
    TERES_TRY(read_mass(mass, scene));
    scene.held.assign(scene.mesh.nodes.size(), 0);
    if (top.has({"fixed_group", "fixed_groups", "fixed"})) {
        TERES_TRY_ASSIGN(const auto fixed, nodes_of(scene, top, {"fixed_group", "fixed_groups", "fixed"}));
        for (const auto node : fixed) scene.held[static_cast<std::size_t>(node)] = 1;
    }
    if (top.has({"springs", "spring"})) {
        TERES_TRY_ASSIGN(const JsonObject springs, top.object({"springs", "spring"}));
        TERES_TRY(read_springs(springs, scene));
    }
    if (top.has({"tool"})) {
        TERES_TRY_ASSIGN(const JsonObject tool, top.object({"tool"}));
        TERES_TRY(read_tool(tool, scene));
    }
    for (const JsonObject::Keys keys :
         {JsonObject::Keys{"point_load", "point_loads"}, JsonObject::Keys{"load", "loads"}}) {
        TERES_TRY_ASSIGN(const auto loads, top.objects(keys));
        for (const auto& load : loads) TERES_TRY(read_load(load, scene));
    }
    TERES_TRY(read_points(scene));

    TERES_TRY_ASSIGN(const JsonObject generator, top.object({"generator"}));
    TERES_TRY(read_run(generator, top, scene.generator, scene.warnings));
    TERES_TRY(read_tool_use(generator, scene.tool.has_value(), scene.generator));
    TERES_TRY(read_events(generator, scene));
    TERES_TRY(read_recording(generator, scene));
    if (generator.has({"stored_observations", "observations"})) {
        TERES_TRY_ASSIGN(const std::string stored, generator.text({"stored_observations", "observations"}));
        TERES_TRY(read_stored_observations(stored, scene));
    }
    generator.report_unknown(scene.warnings);

    TERES_TRY_ASSIGN(const JsonObject filter, top.object({"filter"}));
    TERES_TRY(read_run(filter, top, scene.filter_run, scene.warnings));
    TERES_TRY(read_tool_use(filter, scene.tool.has_value(), scene.filter_run));
    TERES_TRY_ASSIGN(scene.observation_row_offset, filter.row_offset({"observation_row"}));
    TERES_TRY_ASSIGN(scene.compared_rows, filter.integer({"compared_rows"}, 1, 10000000));
    TERES_TRY_ASSIGN(const std::string settings, filter.text({"settings"}));
    filter.report_unknown(scene.warnings);
    top.report_unknown(scene.warnings);
    TERES_TRY(read_filter_settings(settings, scene));
    TERES_TRY(read_expected(scene));
    return scene;
}

double Scene::truth(std::size_t parameter, int step) const {
    const ParameterTarget& target = filter.targets[parameter];
    if (target.kind == ParameterTarget::Kind::kModulus) return modulus_pa[target.regions.front()];
    double value = springs->springs[target.springs.front()].k[target.coefficient];
    for (const Event& event : events)
        if (step >= event.from_step && event.k[target.coefficient] &&
            std::find(event.springs.begin(), event.springs.end(), target.springs.front()) != event.springs.end())
            value = *event.k[target.coefficient];
    return value;
}

}  // namespace teres::peer
