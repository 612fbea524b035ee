#include "tools/springs/sheet.h"

#include <Eigen/Dense>
#include <cmath>
#include <map>

#include "core/case/csv_table.h"
#include "tools/calculix/recording.h"

namespace teres::tools {
namespace {

constexpr double kLargestStress_pa = 1e10, kLargestMisfit = 0.1;

// P's factors of c1, c2, c3.
Eigen::Vector3d stress_terms(double stretch) {
    const double s = 2.0 * (stretch - 1.0 / (stretch * stretch)), i = stretch * stretch + 2.0 / stretch - 3.0;
    return {s, 2.0 * s * i, 3.0 * s * i * i};
}

// Nodes on the half grid (i along the length, j across, k over the thickness), numbered when first asked for.
class HalfGrid {
  public:
    HalfGrid(const Sheet& sheet, int along, int across) : sheet_(sheet), along_(along), across_(across) {}
    std::int32_t id(int i, int j, int k) {
        const auto [entry, added] = ids_.try_emplace({i, j, k}, static_cast<std::int32_t>(nodes.size()));
        if (added)
            nodes.push_back({sheet_.length_m * i / (2 * along_), sheet_.width_m * (j / (2.0 * across_) - 0.5),
                             sheet_.thickness_m * (k / 2.0 - 0.5)});
        return entry->second;
    }
    std::vector<Point> nodes;

  private:
    const Sheet& sheet_;
    int along_, across_;
    std::map<std::array<int, 3>, std::int32_t> ids_;
};

// Corners (a, b, c) of a triangle in half-grid steps; CalculiX's order of C3D15.
std::vector<std::int32_t> wedge(HalfGrid& grid, const std::array<std::array<int, 2>, 3>& p) {
    std::vector<std::int32_t> ids;
    for (const int k : {0, 2})
        for (const auto& c : p) ids.push_back(grid.id(c[0], c[1], k));
    for (const int k : {0, 2})
        for (std::size_t c = 0; c < 3; ++c) {
            const auto &a = p[c], &b = p[(c + 1) % 3];
            ids.push_back(grid.id((a[0] + b[0]) / 2, (a[1] + b[1]) / 2, k));
        }
    for (const auto& c : p) ids.push_back(grid.id(c[0], c[1], 1));
    return ids;
}

}  // namespace

double SheetMaterial::stress_pa(double stretch) const {
    return stress_terms(stretch).dot(Eigen::Vector3d(c1_pa, c2_pa, c3_pa));
}

SheetMaterial neo_hookean_sheet(double youngs_modulus_pa, double poissons_ratio) {
    char name[64];
    std::snprintf(name, sizeof name, "neo-Hookean, E = %g MPa", 1e-6 * youngs_modulus_pa);
    return {name, youngs_modulus_pa / (4.0 * (1.0 + poissons_ratio)), 0.0, 0.0, poissons_ratio};
}

Result<SheetMaterial> sheet_of_curve(const std::filesystem::path& file, double poissons_ratio, double strain) {
    const std::array<CsvColumn, 2> columns{{{"strain", CsvKind::kNumber}, {"stress_pa", CsvKind::kNumber}}};
    TERES_TRY_ASSIGN(const CsvTable table, CsvTable::read(file, columns));
    if (table.num_rows() < 4)
        return invalid_input(file.string() + ": " + std::to_string(table.num_rows()) + " rows, at least 4 are needed");
    const auto rows = static_cast<Eigen::Index>(table.num_rows());
    Eigen::MatrixXd A(rows, 3);
    Eigen::VectorXd P(rows);
    for (std::size_t r = 0; r < table.num_rows(); ++r) {
        const double e = table.number(r, 0), p = table.number(r, 1);
        if (!(e >= 0.0 && e <= 3.0))
            return invalid_input(table.place(r) + ": strain = " + calculix::number(e) +
                                 ", expected 0 to 3 (1 = 100 %)");
        if (!(p >= 0.0 && p <= kLargestStress_pa))
            return invalid_input(table.place(r) + ": stress_pa = " + calculix::number(p) + ", expected 0 to 1e10");
        A.row(static_cast<Eigen::Index>(r)) = stress_terms(1.0 + e).transpose();
        P(static_cast<Eigen::Index>(r)) = p;
    }
    const Eigen::VectorXd scale = A.colwise().norm().cwiseMax(1e-300);
    const Eigen::VectorXd c =
        (A * scale.cwiseInverse().asDiagonal()).colPivHouseholderQr().solve(P).cwiseQuotient(scale);
    const SheetMaterial m{file.filename().string(), c(0), c(1), c(2), poissons_ratio};
    double last = 0.0;
    for (int i = 1; i <= 100; ++i) {
        const double stress = m.stress_pa(1.0 + strain * i / 100.0);
        if (!(m.c1_pa > 0.0) || !(stress > last))
            return invalid_input(file.string() + ": the Yeoh law fitted to it does not rise at strain " +
                                 calculix::number(strain * i / 100.0) + " (c1, c2, c3 = " + calculix::number(m.c1_pa) +
                                 ", " + calculix::number(m.c2_pa) + ", " + calculix::number(m.c3_pa) +
                                 " Pa): is the curve monotone, and does it reach this strain?");
        last = stress;
    }
    const double misfit = (A * c - P).cwiseAbs().maxCoeff() / std::max(P.maxCoeff(), 1e-300);
    if (!(misfit <= kLargestMisfit))
        return invalid_input(file.string() + ": the Yeoh law fitted to it misses it by " +
                             calculix::number(std::round(100.0 * misfit)) +
                             " % of its largest stress, at most 10 % is taken");
    return m;
}

Eigen::Matrix3Xd edge_at_rest(const Sheet& sheet) {
    Eigen::Matrix3Xd X(3, sheet.columns);
    for (int c = 0; c < sheet.columns; ++c)
        X.col(c) << sheet.length_m, sheet.width_m * (static_cast<double>(c) / (sheet.columns - 1) - 0.5), 0.0;
    return X;
}

Result<SheetPath> stretch_sheet(const Sheet& sheet, const SheetMaterial& material, const std::filesystem::path& scratch,
                                double limit_s) {
    const int across = sheet.cells_per_column * (sheet.columns - 1);
    const int along = std::max(2, static_cast<int>(std::lround(across * sheet.length_m / sheet.width_m)));
    HalfGrid grid(sheet, along, across);
    calculix::CalculixRecording r;
    calculix::Part part;
    part.element = calculix::Part::Element::kWedge15;
    part.material.law = calculix::CalculixMaterial::Law::kYeoh;
    part.material.youngs_modulus_pa = material.youngs_modulus_pa();
    part.material.poissons_ratio = material.poissons_ratio;
    part.material.yeoh_c20_pa = material.c2_pa;
    part.material.yeoh_c30_pa = material.c3_pa;
    for (int i = 0; i < 2 * along; i += 2)
        for (int j = 0; j < 2 * across; j += 2) {  // diagonals turn, so that the sheet has no preferred side
            const std::array<int, 2> a{i, j}, b{i + 2, j}, c{i + 2, j + 2}, d{i, j + 2};
            const bool turned = ((i + j) / 2) % 2 == 1;
            part.elements.push_back(wedge(grid, turned ? std::array{a, b, d} : std::array{a, b, c}));
            part.elements.push_back(wedge(grid, turned ? std::array{b, c, d} : std::array{a, c, d}));
        }
    // Consistent load of an even traction on an 8-node face: -1/12 on corners, 1/3 on mid-side nodes.
    const double load = sheet.load_n(material) / across;
    std::map<std::int32_t, double> force;
    const int i = 2 * along;
    for (int j = 0; j < 2 * across; j += 2)
        for (const int k : {0, 2}) {
            force[grid.id(i, j, k)] -= load / 12.0;
            force[grid.id(i, j + 2, k)] -= load / 12.0;
            force[grid.id(i, j + 1, k)] += load / 3.0;
            force[grid.id(i, j + k, 1)] += load / 3.0;
        }
    calculix::NodalLoad pull{{}, {{0.0, 1.0}, {0.0, 1.0}}};
    for (const auto& [node, f] : force) pull.pattern.push_back({node, {f, 0.0, 0.0}});
    r.loads.push_back(pull);
    for (int axis = 0; axis < 3; ++axis) {
        calculix::Support support;
        support.axis = axis;
        for (int j = 0; j <= 2 * across; ++j)
            for (int k = 0; k <= 2; ++k)
                if (j % 2 == 0 || k != 1) support.nodes.push_back(grid.id(0, j, k));
        r.supports.push_back(support);
    }
    for (int c = 0; c < sheet.columns; ++c) r.output_nodes.push_back(grid.id(i, 2 * sheet.cells_per_column * c, 1));
    SheetPath path;
    path.elements = part.elements.size();
    for (int s = 1; s <= sheet.steps; ++s) path.load_share.push_back(static_cast<double>(s) / sheet.steps);
    r.nodes = grid.nodes;
    r.parts.push_back(std::move(part));
    r.times_s = path.load_share;
    r.max_increment_s = 1.0 / sheet.steps;
    r.residual = 1e-3;
    r.correction = 1e-2;
    TERES_TRY_ASSIGN(const calculix::RecordingSolution solved, calculix::solve_recording(r, scratch, limit_s));
    path.seconds = solved.seconds;
    for (const auto& rows : solved.displacement_m) {
        Eigen::Matrix3Xd x = edge_at_rest(sheet);
        for (int c = 0; c < sheet.columns; ++c) {
            const auto& u = rows.at(r.output_nodes[static_cast<std::size_t>(c)]);
            x.col(c) += Eigen::Vector3d(u[0], u[1], u[2]);
        }
        path.edge_m.push_back(x);
    }
    return path;
}

}  // namespace teres::tools
