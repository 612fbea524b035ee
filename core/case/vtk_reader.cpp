// Legacy ASCII VTK, DATASET UNSTRUCTURED_GRID, tetrahedra only. File versions 2.0 to 5.1.
#include <cmath>
#include <limits>
#include <utility>

#include "core/case/case_reader.h"
#include "core/case/geometry.h"
#include "core/case/text_file.h"

namespace teres {
namespace {

constexpr int kVtkTetra = 10;

std::string upper(std::string_view word) {
    std::string out(word);
    for (char& c : out)
        if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
    return out;
}

class VtkParser {
  public:
    VtkParser(std::string_view text, const std::string& name) : cursor_(text), name_(name) {}

    Result<TetMeshData> parse() {
        TERES_TRY(read_header());
        while (const auto word = cursor_.next_word()) TERES_TRY(read_section(upper(*word)));
        if (!have_points_) return missing("POINTS");
        if (!have_cells_) return missing("CELLS");
        if (!have_types_) return missing("CELL_TYPES");
        return std::move(mesh_);
    }

    /// Line on which a tetrahedron or node stands, for the checks made afterwards.
    std::string place_of_tet(std::size_t tet) const { return name_ + ":" + std::to_string(tet_lines_[tet]); }

  private:
    tl::unexpected<Error> wrong(const std::string& text) const {
        return invalid_input(name_ + ":" + std::to_string(cursor_.line()) + ": " + text);
    }
    tl::unexpected<Error> missing(const char* section) const {
        return wrong(std::string("no ") + section + " section");
    }

    Status read_header() {
        const auto version = cursor_.next_line();
        if (!version) return invalid_input(name_ + ":1: empty file, expected '# vtk DataFile Version'");
        if (version->substr(0, 22) != "# vtk DataFile Version")
            return wrong(in_quotes(*version) + ", expected '# vtk DataFile Version ...'");
        if (!cursor_.next_line()) return wrong("truncated before the title line");
        TERES_TRY(expect_word("ASCII"));
        TERES_TRY(expect_word("DATASET"));
        return expect_word("UNSTRUCTURED_GRID");
    }

    Status expect_word(const char* expected) {
        const auto word = cursor_.next_word();
        if (!word) return wrong(std::string("truncated: expected ") + expected);
        if (upper(*word) != expected) return wrong(in_quotes(*word) + ", expected " + expected);
        return {};
    }
    Result<std::string_view> word(const char* what) {
        const auto found = cursor_.next_word();
        if (!found) return wrong(std::string("truncated: expected ") + what);
        return *found;
    }
    Result<double> number(const char* what) {
        TERES_TRY_ASSIGN(const std::string_view text, word(what));
        const auto value = parse_number(text);
        if (!value || !std::isfinite(*value))
            return wrong(in_quotes(text) + ", expected " + what + ", a finite number");
        return *value;
    }
    Result<std::int64_t> integer(const char* what, std::int64_t min, std::int64_t max) {
        TERES_TRY_ASSIGN(const std::string_view text, word(what));
        const auto value = parse_integer(text);
        if (!value || *value < min || *value > max)
            return wrong(in_quotes(text) + ", expected " + what + ", an integer in [" + std::to_string(min) + ", " +
                         std::to_string(max) + "]");
        return *value;
    }
    // Announced number of items that need `numbers_each` numbers each; bounded by what the file can hold, so
    // that a huge count cannot make us allocate.
    Result<std::size_t> count(const char* what, std::size_t numbers_each) {
        TERES_TRY_ASSIGN(const std::int64_t n, integer(what, 0, std::numeric_limits<std::int32_t>::max()));
        if (static_cast<std::size_t>(n) > (cursor_.bytes_left() + 1) / (2 * numbers_each))
            return wrong(std::string(what) + " " + std::to_string(n) + " is more than the rest of the file can hold (" +
                         std::to_string(cursor_.bytes_left()) + " bytes); truncated?");
        return static_cast<std::size_t>(n);
    }

    Status read_section(const std::string& keyword) {
        if (keyword == "POINTS") return read_points();
        if (keyword == "CELLS") return read_cells();
        if (keyword == "CELL_TYPES") return read_cell_types();
        if (keyword == "METADATA") return skip_metadata();
        if (keyword == "POINT_DATA") return start_data(false);
        if (keyword == "CELL_DATA") return start_data(true);
        if (in_data_) return read_attribute(keyword);
        return wrong(in_quotes(keyword) + " is not a known section");
    }

    Status once(bool& flag, const char* section) {
        if (flag) return wrong(std::string(section) + " appears twice");
        flag = true;
        return {};
    }

    Status read_points() {
        TERES_TRY(once(have_points_, "POINTS"));
        TERES_TRY_ASSIGN(const std::size_t n, count("number of points", 3));
        TERES_TRY_ASSIGN(const std::string_view type, word("type of the points"));
        if (upper(type) != "DOUBLE" && upper(type) != "FLOAT")
            return wrong("points of type " + in_quotes(type) + ", expected double or float");
        mesh_.nodes.resize(n);
        for (Point& node : mesh_.nodes)
            for (double& coordinate : node) {
                TERES_TRY_ASSIGN(coordinate, number("a coordinate"));
            }
        return {};
    }

    Result<std::int32_t> node_id() {
        const auto last = static_cast<std::int64_t>(mesh_.nodes.size()) - 1;
        TERES_TRY_ASSIGN(const std::int64_t id, integer("a node id", 0, last));
        return static_cast<std::int32_t>(id);
    }

    Status read_cells() {
        TERES_TRY(once(have_cells_, "CELLS"));
        if (!have_points_) return wrong("CELLS before POINTS");
        TERES_TRY_ASSIGN(const std::size_t n, count("number of cells", 1));
        TERES_TRY_ASSIGN(const std::size_t size, count("size of CELLS", 1));
        TextCursor before = cursor_;
        TERES_TRY_ASSIGN(const std::string_view first, word("cells"));
        if (upper(first) == "OFFSETS") return read_offset_cells(n, size);
        cursor_ = before;
        if (size != 5 * n)
            return wrong("CELLS " + std::to_string(n) + " " + std::to_string(size) + ": size must be " +
                         std::to_string(5 * n) + " for tetrahedra");
        mesh_.tets.resize(n);
        tet_lines_.resize(n);
        for (std::size_t i = 0; i < n; ++i) {
            TERES_TRY(integer("number of nodes of a tetrahedron", 4, 4));
            tet_lines_[i] = cursor_.line();
            for (std::int32_t& id : mesh_.tets[i]) {
                TERES_TRY_ASSIGN(id, node_id());
            }
        }
        return {};
    }

    // Version 5: CELLS <cells + 1> <size of connectivity>, OFFSETS <type> ..., CONNECTIVITY <type> ...
    Status read_offset_cells(std::size_t num_offsets, std::size_t size) {
        TERES_TRY(word("type of the offsets"));
        const std::size_t n = num_offsets > 0 ? num_offsets - 1 : 0;
        if (size != 4 * n)
            return wrong("CELLS " + std::to_string(num_offsets) + " " + std::to_string(size) + ": size must be " +
                         std::to_string(4 * n) + " for tetrahedra");
        for (std::size_t i = 0; i < num_offsets; ++i) {
            const auto expected = static_cast<std::int64_t>(4 * i);
            TERES_TRY(integer("offset of a tetrahedron", expected, expected));
        }
        TERES_TRY(expect_word("CONNECTIVITY"));
        TERES_TRY(word("type of the connectivity"));
        mesh_.tets.resize(n);
        tet_lines_.resize(n);
        for (std::size_t i = 0; i < n; ++i)
            for (std::int32_t& id : mesh_.tets[i]) {
                TERES_TRY_ASSIGN(id, node_id());
                tet_lines_[i] = cursor_.line();
            }
        return {};
    }

    Status read_cell_types() {
        TERES_TRY(once(have_types_, "CELL_TYPES"));
        if (!have_cells_) return wrong("CELL_TYPES before CELLS");
        TERES_TRY_ASSIGN(const std::size_t n, count("number of cell types", 1));
        if (n != mesh_.tets.size())
            return wrong("CELL_TYPES " + std::to_string(n) + ", expected " + std::to_string(mesh_.tets.size()));
        for (std::size_t i = 0; i < n; ++i) TERES_TRY(integer("cell type (tetrahedra only)", kVtkTetra, kVtkTetra));
        return {};
    }

    Status skip_metadata() {
        cursor_.next_line();  // rest of the keyword's line
        while (const auto line = cursor_.next_line())
            if (line->find_first_not_of(" \t") == std::string_view::npos) break;
        return {};
    }

    Status start_data(bool cells) {
        const std::size_t expected = cells ? mesh_.tets.size() : mesh_.nodes.size();
        const auto n = static_cast<std::int64_t>(expected);
        TERES_TRY(integer(cells ? "number of cells" : "number of points", n, n));
        in_data_ = true;
        cell_data_ = cells;
        num_tuples_ = expected;
        return {};
    }

    Status skip_numbers(std::size_t tuples, std::int64_t components) {
        for (std::size_t i = 0; i < tuples; ++i)
            for (std::int64_t k = 0; k < components; ++k) {
                TERES_TRY_ASSIGN(const std::string_view text, word("a value"));
                if (!parse_number(text)) return wrong(in_quotes(text) + ", expected a number");
            }
        return {};
    }

    Status read_attribute(const std::string& keyword) {
        constexpr std::int64_t kMaxComponents = 1000;
        TERES_TRY_ASSIGN(const std::string_view attribute, word("name of the attribute"));
        if (keyword == "SCALARS") return read_scalars(attribute);
        if (keyword == "FIELD") return read_field();
        if (keyword == "LOOKUP_TABLE") {
            TERES_TRY_ASSIGN(const std::size_t entries, count("size of the lookup table", 4));
            return skip_numbers(entries, 4);
        }
        if (keyword == "COLOR_SCALARS") {
            TERES_TRY_ASSIGN(const std::int64_t components, integer("components", 1, kMaxComponents));
            return skip_numbers(num_tuples_, components);
        }
        if (keyword == "TEXTURE_COORDINATES") {
            TERES_TRY_ASSIGN(const std::int64_t components, integer("dimension", 1, 3));
            TERES_TRY(word("type"));
            return skip_numbers(num_tuples_, components);
        }
        if (keyword == "VECTORS" || keyword == "NORMALS" || keyword == "TENSORS") {
            TERES_TRY(word("type"));
            return skip_numbers(num_tuples_, keyword == "TENSORS" ? 9 : 3);
        }
        return wrong(in_quotes(keyword) + " is not a known attribute");
    }

    // SCALARS name type [components]  [LOOKUP_TABLE name]  values
    Status read_scalars(std::string_view attribute) {
        TERES_TRY(word("type"));
        std::int64_t components = 1;
        TextCursor before = cursor_;
        const std::size_t line = cursor_.line();
        auto next = cursor_.next_word();
        if (next && cursor_.line() == line) {
            const auto given = parse_integer(*next);
            if (!given || *given < 1 || *given > 4) return wrong(in_quotes(*next) + ", expected 1 to 4 components");
            components = *given;
            before = cursor_;
            next = cursor_.next_word();
        }
        if (next && upper(*next) == "LOOKUP_TABLE") {
            TERES_TRY(word("name of the lookup table"));
        } else {
            cursor_ = before;
        }
        if (!cell_data_ || attribute != "region") return skip_numbers(num_tuples_, components);
        if (components != 1) return wrong("region has " + std::to_string(components) + " components, expected 1");
        if (!mesh_.region.empty()) return wrong("region appears twice");
        return read_region();
    }

    Status read_field() {
        TERES_TRY_ASSIGN(const std::size_t num_arrays, count("number of arrays", 1));
        for (std::size_t i = 0; i < num_arrays; ++i) {
            TERES_TRY_ASSIGN(const std::string_view array, word("name of the array"));
            TERES_TRY_ASSIGN(const std::size_t components, count("components", 1));
            TERES_TRY_ASSIGN(const std::size_t tuples, count("tuples", 1));
            TERES_TRY(word("type"));
            const bool is_region = cell_data_ && array == "region" && components == 1 && tuples == num_tuples_;
            if (is_region && mesh_.region.empty()) {
                TERES_TRY(read_region());
            } else {
                TERES_TRY(skip_numbers(tuples, static_cast<std::int64_t>(components)));
            }
        }
        return {};
    }

    Status read_region() {
        std::vector<std::int32_t> region(num_tuples_);
        for (std::int32_t& id : region) {
            TERES_TRY_ASSIGN(const double value, number("a region number"));
            if (value != std::floor(value) || std::abs(value) > 1e9)
                return wrong("region " + to_text(value) + ", expected an integer within 1e9");
            id = static_cast<std::int32_t>(value);
        }
        mesh_.region = std::move(region);
        return {};
    }

    TextCursor cursor_;
    const std::string& name_;
    TetMeshData mesh_;
    std::vector<std::size_t> tet_lines_;
    bool have_points_ = false, have_cells_ = false, have_types_ = false;
    bool in_data_ = false, cell_data_ = false;
    std::size_t num_tuples_ = 0;
};

}  // namespace

Result<TetMeshData> parse_vtk_tets(std::string_view text, const std::string& name, bool keep_order) {
    VtkParser parser(without_byte_order_mark(text), name);
    TERES_TRY_ASSIGN(TetMeshData mesh, parser.parse());
    if (mesh.tets.empty()) return invalid_input(name + ": no tetrahedra");
    for (std::size_t i = 0; i < mesh.tets.size(); ++i) {
        const double volume = signed_volume_m3(mesh, i);
        // Degenerate: a regular tetrahedron of edge a has a^3 / (6 sqrt 2); slivers below 1e-6 of that of the
        // longest edge have a condition that no solver survives.
        const double edge = longest_edge_m(mesh, i);
        const std::string what = parser.place_of_tet(i) + ": tetrahedron " + std::to_string(i);
        if (!(std::abs(volume) > 1e-6 * edge * edge * edge / 8.485281374))
            return invalid_input(what + " is degenerate: volume " + to_text(volume) + " m^3 at a longest edge of " +
                                 to_text(edge) + " m");
        if (volume < 0.0 && !keep_order)
            return invalid_input(what + " is inverted: volume " + to_text(volume) + " m^3, must be above 0");
    }
    return mesh;
}

Result<TetMeshData> read_vtk_tets(const std::filesystem::path& file, bool keep_order) {
    TERES_TRY_ASSIGN(const std::string text, read_text_file(file));
    return parse_vtk_tets(text, file.string(), keep_order);
}

}  // namespace teres
