// OBJ, STL (ASCII, binary), PLY (ASCII, binary little endian) and legacy VTK POLYDATA (ASCII).
#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <map>

#include "core/case/text_file.h"
#include "tools/atlas/triangle_surface.h"

namespace teres {
namespace {

using Eigen::Vector3d;

std::string lower(std::string_view word) {
    std::string out(word);
    for (char& c : out) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return out;
}

class SurfaceParser {
  public:
    SurfaceParser(std::string_view text, std::string name) : text_(text), cursor_(text), name_(std::move(name)) {}

    Result<TriangleSurface> parse(const std::string& extension, double unit_m) {
        if (extension == ".obj") {
            TERES_TRY(obj());
        } else if (extension == ".stl") {
            TERES_TRY(stl());
        } else if (extension == ".ply") {
            TERES_TRY(ply());
        } else if (extension == ".vtk") {
            TERES_TRY(vtk());
        } else {
            return invalid_input(name_ + ": '" + extension + "' is not a surface, expected .obj, .stl, .ply or .vtk");
        }
        return finish(unit_m);
    }

  private:
    tl::unexpected<Error> wrong(const std::string& text) const {
        return invalid_input(name_ + ":" + std::to_string(cursor_.line()) + ": " + text);
    }
    Result<std::string_view> word(const char* what) {
        const auto found = cursor_.next_word();
        if (!found) return wrong(std::string("truncated: expected ") + what);
        return *found;
    }
    Result<double> number(std::string_view text) const {
        const auto value = parse_number(text);
        if (!value || !std::isfinite(*value)) return wrong(in_quotes(text) + ", expected a finite coordinate");
        return *value;
    }
    Result<double> number() {
        TERES_TRY_ASSIGN(const std::string_view text, word("a number"));
        return number(text);
    }
    Result<std::size_t> count(const char* what, std::size_t bytes_each) {
        TERES_TRY_ASSIGN(const std::string_view text, word(what));
        const auto value = parse_integer(text);
        if (!value || *value < 0 || static_cast<std::size_t>(*value) > text_.size() / bytes_each)
            return wrong(in_quotes(text) + " " + what + ", more than the file can hold or not a count");
        return static_cast<std::size_t>(*value);
    }
    Status corner(std::string_view text, std::vector<std::int64_t>& face) const {
        const auto value = parse_integer(text.substr(0, text.find('/')));
        if (!value) return wrong(in_quotes(text) + ", expected the index of a vertex");
        face.push_back(*value);
        return {};
    }
    // Fans a polygon of 0-based indices into triangles.
    Status add_face(const std::vector<std::int64_t>& face) {
        if (face.size() < 3) return wrong("a face of " + std::to_string(face.size()) + " corners, expected at least 3");
        for (const auto i : face)
            if (i < 0 || i >= static_cast<std::int64_t>(vertices_.size()))
                return wrong("vertex " + std::to_string(i) + " of a face does not exist, there are " +
                             std::to_string(vertices_.size()));
        for (std::size_t k = 2; k < face.size(); ++k)
            faces_.push_back({static_cast<std::int32_t>(face[0]), static_cast<std::int32_t>(face[k - 1]),
                              static_cast<std::int32_t>(face[k])});
        return {};
    }

    Status obj() {
        while (const auto line = cursor_.next_line()) {
            TextCursor words(*line);
            const auto key = words.next_word();
            if (!key || (*key != "v" && *key != "f")) continue;
            if (*key == "v") {
                Vector3d v;
                for (int k = 0; k < 3; ++k) {
                    const auto text = words.next_word();
                    if (!text) return wrong("a vertex of fewer than 3 coordinates");
                    TERES_TRY_ASSIGN(v[k], number(*text));
                }
                vertices_.push_back(v);
            } else {
                std::vector<std::int64_t> face;
                while (const auto text = words.next_word()) {
                    TERES_TRY(corner(*text, face));
                    face.back() =
                        face.back() < 0 ? face.back() + static_cast<std::int64_t>(vertices_.size()) : face.back() - 1;
                }
                TERES_TRY(add_face(face));
            }
        }
        return {};
    }

    void add_soup_corner(const Vector3d& v) {
        const auto [entry, is_new] = welded_.try_emplace({v[0], v[1], v[2]}, vertices_.size());
        if (is_new) vertices_.push_back(v);
        soup_.push_back(static_cast<std::int64_t>(entry->second));
        if (soup_.size() < 3) return;
        if (soup_[0] != soup_[1] && soup_[1] != soup_[2] && soup_[2] != soup_[0])
            faces_.push_back({static_cast<std::int32_t>(soup_[0]), static_cast<std::int32_t>(soup_[1]),
                              static_cast<std::int32_t>(soup_[2])});
        soup_.clear();
    }

    Status stl() {
        constexpr std::size_t kHeader = 84, kFacet = 50;
        if (text_.size() >= kHeader) {
            std::uint32_t n = 0;
            std::memcpy(&n, text_.data() + 80, 4);
            if (text_.size() == kHeader + kFacet * n) return binary_stl(n);
        }
        if (lower(text_.substr(0, 5)) != "solid")
            return wrong("neither ASCII STL ('solid') nor a whole binary STL file");
        while (const auto text = cursor_.next_word()) {
            if (lower(*text) != "vertex") continue;
            Vector3d v;
            for (int k = 0; k < 3; ++k) {
                TERES_TRY_ASSIGN(v[k], number());
            }
            add_soup_corner(v);
        }
        if (!soup_.empty()) return wrong("truncated inside a facet");
        return {};
    }
    Status binary_stl(std::uint32_t n) {
        for (std::uint32_t i = 0; i < n; ++i)
            for (std::size_t k = 0; k < 3; ++k) {
                std::array<float, 3> v{};
                std::memcpy(v.data(), text_.data() + 84 + 50 * std::size_t{i} + 12 * (k + 1), 12);
                const Vector3d p(v[0], v[1], v[2]);
                if (!p.allFinite()) return invalid_input(name_ + ": facet " + std::to_string(i) + " is not finite");
                add_soup_corner(p);
            }
        return {};
    }

    struct Property {
        std::string list_type, type, name;
    };
    struct Element {
        std::string name;
        std::size_t count = 0;
        std::vector<Property> properties;
    };

    Status ply() {
        if (cursor_.next_line().value_or("") != "ply") return wrong("expected 'ply'");
        std::string format;
        std::vector<Element> elements;
        std::size_t body = 0;
        while (true) {
            const auto line = cursor_.next_line();
            if (!line) return wrong("truncated: no end_header");
            body = text_.size() - cursor_.bytes_left();
            TextCursor words(*line);
            const std::string key(words.next_word().value_or(""));
            if (key == "end_header") break;
            if (key == "format") format = words.next_word().value_or("");
            if (key == "element") {
                Element e;
                e.name = words.next_word().value_or("");
                const auto n = parse_integer(words.next_word().value_or(""));
                if (!n || *n < 0 || static_cast<std::size_t>(*n) > text_.size())
                    return wrong("count of an element out of range");
                e.count = static_cast<std::size_t>(*n);
                elements.push_back(e);
            }
            if (key == "property" && !elements.empty()) {
                Property p;
                p.type = words.next_word().value_or("");
                if (p.type == "list") {
                    p.list_type = words.next_word().value_or("");
                    p.type = words.next_word().value_or("");
                }
                p.name = words.next_word().value_or("");
                elements.back().properties.push_back(p);
            }
        }
        if (format != "ascii" && format != "binary_little_endian")
            return wrong("format " + in_quotes(format) + ", expected ascii or binary_little_endian");
        position_ = body;
        binary_ = format != "ascii";
        for (const Element& e : elements)
            for (std::size_t i = 0; i < e.count; ++i) TERES_TRY(ply_entry(e));
        return {};
    }
    Status ply_entry(const Element& e) {
        Vector3d v = Vector3d::Zero();
        for (const Property& p : e.properties) {
            if (p.list_type.empty()) {
                TERES_TRY_ASSIGN(const double value, ply_number(p.type));
                if (p.name == "x" || p.name == "y" || p.name == "z") v[p.name[0] - 'x'] = value;
                continue;
            }
            TERES_TRY_ASSIGN(const double n, ply_number(p.list_type));
            if (!(n >= 0.0) || n > static_cast<double>(text_.size())) return wrong("length of a list out of range");
            std::vector<std::int64_t> face;
            for (int i = 0; i < static_cast<int>(n); ++i) {
                TERES_TRY_ASSIGN(const double index, ply_number(p.type));
                face.push_back(static_cast<std::int64_t>(index));
            }
            if (e.name == "face" && (p.name == "vertex_indices" || p.name == "vertex_index")) TERES_TRY(add_face(face));
        }
        if (e.name == "vertex") {
            if (!v.allFinite()) return wrong("vertex " + std::to_string(vertices_.size()) + " is not finite");
            vertices_.push_back(v);
        }
        return {};
    }
    Result<double> ply_number(const std::string& type) {
        if (!binary_) return number();
        const auto take = [&]<class T>(T value) -> Result<double> {
            if (position_ + sizeof(T) > text_.size()) return invalid_input(name_ + ": truncated PLY data");
            std::memcpy(&value, text_.data() + position_, sizeof(T));
            position_ += sizeof(T);
            return static_cast<double>(value);
        };
        if (type == "float" || type == "float32") return take(float{});
        if (type == "double" || type == "float64") return take(double{});
        if (type == "char" || type == "int8") return take(std::int8_t{});
        if (type == "uchar" || type == "uint8") return take(std::uint8_t{});
        if (type == "short" || type == "int16") return take(std::int16_t{});
        if (type == "ushort" || type == "uint16") return take(std::uint16_t{});
        if (type == "int" || type == "int32") return take(std::int32_t{});
        if (type == "uint" || type == "uint32") return take(std::uint32_t{});
        return invalid_input(name_ + ": property of unknown type " + in_quotes(type));
    }

    Status vtk() {
        if (cursor_.next_line().value_or("").substr(0, 22) != "# vtk DataFile Version")
            return wrong("expected '# vtk DataFile Version'");
        cursor_.next_line();
        while (const auto text = cursor_.next_word()) {
            const std::string key = lower(*text);
            if (key == "binary") return wrong("binary VTK is not read, expected ASCII");
            if (key == "dataset") {
                TERES_TRY_ASSIGN(const std::string_view set, word("POLYDATA"));
                if (lower(set) != "polydata") return wrong(in_quotes(set) + ", expected POLYDATA: a triangle surface");
            } else if (key == "points") {
                TERES_TRY_ASSIGN(const std::size_t n, count("points", 6));
                TERES_TRY(word("a type"));
                for (std::size_t i = 0; i < n; ++i) {
                    Vector3d v;
                    for (int k = 0; k < 3; ++k) {
                        TERES_TRY_ASSIGN(v[k], number());
                    }
                    vertices_.push_back(v);
                }
            } else if (key == "polygons") {
                TERES_TRY_ASSIGN(const std::size_t n, count("polygons", 4));
                TERES_TRY_ASSIGN(const std::size_t size, count("polygon numbers", 1));
                TextCursor before = cursor_;
                const bool offsets = lower(cursor_.next_word().value_or("")) == "offsets";  // version 5.1
                if (!offsets) cursor_ = before;
                TERES_TRY(offsets ? vtk_offset_polygons(n, size) : vtk_polygons(n));
            } else if (key == "point_data" || key == "cell_data") {
                break;
            }
        }
        return {};
    }
    Status vtk_polygons(std::size_t n) {
        for (std::size_t i = 0; i < n; ++i) {
            TERES_TRY_ASSIGN(const std::size_t corners, count("corners", 1));
            TERES_TRY(polygon(corners));
        }
        return {};
    }
    Status vtk_offset_polygons(std::size_t num_offsets, std::size_t) {
        TERES_TRY(word("a type"));
        std::vector<std::size_t> offset(num_offsets);
        for (auto& o : offset) {
            TERES_TRY_ASSIGN(o, count("offset", 1));
        }
        TERES_TRY(word("CONNECTIVITY"));
        TERES_TRY(word("a type"));
        for (std::size_t i = 1; i < num_offsets; ++i) {
            if (offset[i] < offset[i - 1]) return wrong("offsets of polygons go backwards");
            TERES_TRY(polygon(offset[i] - offset[i - 1]));
        }
        return {};
    }
    Status polygon(std::size_t corners) {
        std::vector<std::int64_t> face;
        for (std::size_t k = 0; k < corners; ++k) {
            TERES_TRY_ASSIGN(const std::string_view text, word("the index of a vertex"));
            TERES_TRY(corner(text, face));
        }
        return add_face(face);
    }

    Result<TriangleSurface> finish(double unit_m) {
        if (vertices_.empty() || faces_.empty())
            return invalid_input(name_ + ": " + std::to_string(vertices_.size()) + " vertices and " +
                                 std::to_string(faces_.size()) + " faces: no surface");
        for (const auto& face : faces_)
            for (const auto v : face)
                if (static_cast<std::size_t>(v) >= vertices_.size())
                    return invalid_input(name_ + ": vertex " + std::to_string(v) +
                                         " of a face does not exist, there are " + std::to_string(vertices_.size()));
        TriangleSurface s;
        s.F = std::move(faces_);
        s.V.resize(3, static_cast<Eigen::Index>(vertices_.size()));
        for (std::size_t v = 0; v < vertices_.size(); ++v)
            s.V.col(static_cast<Eigen::Index>(v)) = unit_m * vertices_[v];
        return s;
    }

    std::string_view text_;
    TextCursor cursor_;
    std::string name_;
    std::vector<Vector3d> vertices_;
    std::vector<std::array<std::int32_t, 3>> faces_;
    std::vector<std::int64_t> soup_;  // corners of the STL facet being read
    std::map<std::array<double, 3>, std::size_t> welded_;
    bool binary_ = false;
    std::size_t position_ = 0;  // binary PLY
};

}  // namespace

Result<TriangleSurface> read_surface(const std::filesystem::path& file, double unit_m) {
    TERES_TRY_ASSIGN(const std::string text, read_text_file(file));
    return SurfaceParser(text, file.string()).parse(lower(file.extension().string()), unit_m);
}

}  // namespace teres
