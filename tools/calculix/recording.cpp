#include "tools/calculix/recording.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

namespace teres::calculix {
namespace {

// The first data line of a spring: what has no decimal point is taken for a degree of freedom there.
std::string decimal(double value) {
    std::string text = number(value);
    if (text.find('.') == std::string::npos) text.insert(std::min(text.find('e'), text.size()), ".");
    return text;
}

class Writer {
  public:
    explicit Writer(const CalculixRecording& recording) : r_(recording) {}

    std::string text() {
        model();
        springs();
        curves();
        step();
        return out_.str();
    }

  private:
    void model() {
        out_ << "*NODE, NSET=ALL\n";
        for (const Point& p : r_.nodes) node_line(p);
        for (std::size_t part = 0; part < r_.parts.size(); ++part) {
            const Part& p = r_.parts[part];
            first_element_.push_back(next_element_);
            out_ << "*ELEMENT, TYPE=" << (p.element == Part::Element::kTet10 ? "C3D10" : "C3D15") << ", ELSET=P" << part
                 << "\n";
            for (const auto& element : p.elements) {
                out_ << next_element_++;
                for (std::size_t i = 0; i < element.size(); ++i) out_ << (i == 10 ? ",\n" : ", ") << element[i] + 1;
                out_ << "\n";
            }
        }
        for (std::size_t part = 0; part < r_.parts.size(); ++part)
            out_ << material_card(r_.parts[part].material, "M" + std::to_string(part), "P" + std::to_string(part));
        out_ << "*NSET, NSET=WANTED\n";
        for (const std::int32_t id : r_.output_nodes) out_ << id + 1 << ",\n";
    }

    void springs() {
        std::size_t set = 0;
        for (const GroundSpring& spring : r_.ground_springs)
            for (int axis = 0; axis < 3; ++axis) {
                const double k = spring.stiffness_n_per_m[static_cast<std::size_t>(axis)];
                if (k <= 0.0) continue;
                out_ << "*ELEMENT, TYPE=SPRING1, ELSET=G" << set << "\n"
                     << next_element_++ << ", " << spring.node_id + 1 << "\n*SPRING, ELSET=G" << set << "\n"
                     << axis + 1 << "\n"
                     << number(k) << "\n";
                ++set;
            }
        std::string anchors = "*NSET, NSET=ANCHORS\n";
        for (const LineSpring& spring : r_.line_springs) {
            out_ << "*NODE\n";
            const std::size_t anchor = next_node_;
            node_line(spring.anchor_m);
            anchors += std::to_string(anchor) + ",\n";
            out_ << "*ELEMENT, TYPE=SPRINGA, ELSET=G" << set << "\n"
                 << next_element_++ << ", " << spring.node_id + 1 << ", " << anchor << "\n*SPRING, ELSET=G" << set
                 << ", NONLINEAR\n\n";
            ++set;
            for (const auto& [elongation, force] : spring.elongation_force)
                out_ << decimal(force) << ", " << decimal(elongation) << "\n";
        }
        for (const auto& [node, mass] : r_.masses_kg) {
            out_ << "*ELEMENT, TYPE=MASS, ELSET=G" << set << "\n"
                 << next_element_++ << ", " << node + 1 << "\n*MASS, ELSET=G" << set << "\n"
                 << number(mass) << "\n";
            ++set;
        }
        if (!r_.line_springs.empty()) out_ << anchors << "*BOUNDARY\nANCHORS, 1, 3\n";
        for (const Support& support : r_.supports) {
            const std::string name = "S" + std::to_string(&support - r_.supports.data());
            out_ << "*NSET, NSET=" << name << "\n";
            for (const std::int32_t id : support.nodes) out_ << id + 1 << ",\n";
            if (!support.curve_m) out_ << "*BOUNDARY\n" << name << ", " << support.axis + 1 << "\n";
        }
    }

    void curves() {
        out_ << "*TIME POINTS, NAME=FRAMES\n";
        for (const double t : r_.times_s) out_ << number(t) << "\n";
        const auto all = [&](const char* letter, const auto& items) {
            for (std::size_t i = 0; i < items.size(); ++i) curve(letter + std::to_string(i), items[i].curve);
        };
        all("L", r_.loads);
        all("D", r_.pressures);
        all("B", r_.body_forces);
        for (std::size_t i = 0; i < r_.supports.size(); ++i)
            if (r_.supports[i].curve_m) curve("U" + std::to_string(i), *r_.supports[i].curve_m);
    }

    void step() {
        bool creep = false;
        for (const Part& part : r_.parts) creep |= part.material.creep_per_pa_s > 0.0;
        const double dt = r_.max_increment_s;
        out_ << "*STEP, INC=100000" << (r_.large_displacements ? ", NLGEOM" : "") << "\n"
             << (r_.dynamic ? "*DYNAMIC, ALPHA=0.\n"
                 : creep    ? "*VISCO, CETOL=1e6\n"
                            : "*STATIC\n")
             << number(dt) << ", " << number(r_.times_s.back()) << ", " << number(1e-4 * dt) << ", " << number(dt)
             << "\n"
             << "*CONTROLS, PARAMETERS=FIELD\n"
             << number(r_.residual) << ", " << number(r_.correction) << "\n";
        for (std::size_t i = 0; i < r_.loads.size(); ++i) {
            out_ << "*CLOAD, AMPLITUDE=L" << i << "\n";
            for (const auto& [node, force] : r_.loads[i].pattern)
                for (std::size_t axis = 0; axis < 3; ++axis)
                    if (force[axis] != 0.0) out_ << node + 1 << ", " << axis + 1 << ", " << number(force[axis]) << "\n";
        }
        for (std::size_t i = 0; i < r_.pressures.size(); ++i) {
            out_ << "*DLOAD, AMPLITUDE=D" << i << "\n";
            for (const auto& [part, element, face] : r_.pressures[i].faces)
                out_ << first_element_[static_cast<std::size_t>(part)] + static_cast<std::size_t>(element) << ", P"
                     << face << ", 1.\n";
        }
        for (std::size_t i = 0; i < r_.body_forces.size(); ++i) {
            const Point& g = r_.body_forces[i].direction;
            out_ << "*DLOAD, AMPLITUDE=B" << i << "\n";
            for (std::size_t part = 0; part < r_.parts.size(); ++part)
                if (r_.parts[part].material.density_kg_m3 > 0.0)
                    out_ << "P" << part << ", GRAV, 1., " << number(g[0]) << ", " << number(g[1]) << ", "
                         << number(g[2]) << "\n";
        }
        for (std::size_t i = 0; i < r_.supports.size(); ++i)
            if (r_.supports[i].curve_m)
                out_ << "*BOUNDARY, AMPLITUDE=U" << i << "\nS" << i << ", " << r_.supports[i].axis + 1 << ", "
                     << r_.supports[i].axis + 1 << ", 1.\n";
        out_ << "*NODE PRINT, NSET=WANTED, TIME POINTS=FRAMES\nU\n*END STEP\n";
    }

    void curve(const std::string& name, const Curve& curve) {
        out_ << "*AMPLITUDE, NAME=" << name << "\n";
        for (std::size_t k = 0; k < curve.t_s.size(); ++k)
            out_ << number(curve.t_s[k]) << ", " << number(curve.value[k]) << "\n";
    }
    void node_line(const Point& p) {
        out_ << next_node_++ << ", " << number(p[0]) << ", " << number(p[1]) << ", " << number(p[2]) << "\n";
    }

    const CalculixRecording& r_;
    std::ostringstream out_;
    std::size_t next_node_ = 1, next_element_ = 1;
    std::vector<std::size_t> first_element_;
};

}  // namespace

std::string recording_input(const CalculixRecording& recording) {
    return Writer(recording).text();
}

Result<RecordingSolution> solve_recording(const CalculixRecording& recording, const std::filesystem::path& scratch,
                                          double limit_s) {
    std::error_code failed;
    std::filesystem::create_directories(scratch, failed);
    if (failed) return host_fault(scratch.string() + ": " + failed.message());
    std::ofstream(scratch / "job.inp") << recording_input(recording);
    TERES_TRY_ASSIGN(const CalculixRun run, run_calculix(scratch, "job", 1, limit_s));
    TERES_TRY_ASSIGN(std::vector<CalculixBlock> blocks, read_blocks(run.dat, "displacements"));
    RecordingSolution solution;
    solution.seconds = run.seconds;
    std::size_t next = 0;
    for (const double t : recording.times_s) {
        while (next < blocks.size() && blocks[next].time < t - 1e-5) ++next;
        if (next == blocks.size() || std::abs(blocks[next].time - t) > 1e-5)
            return not_usable("ccx gave no displacements at t = " + number(t) + " s");
        solution.displacement_m.push_back(blocks[next].rows);
    }
    return solution;
}

}  // namespace teres::calculix
