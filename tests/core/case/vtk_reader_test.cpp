#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/case/case_reader.h"
#include "core/case/geometry.h"

namespace teres {
namespace {

using ::testing::HasSubstr;

// Two tetrahedra that share a face; line numbers below count from '# vtk' = 1.
const std::string kGood =
    "# vtk DataFile Version 3.0\n"
    "two tets # with a comment, and commas\n"
    "ASCII\n"
    "DATASET UNSTRUCTURED_GRID\n"
    "POINTS 5 double\n"
    "0 0 0\n"
    "0.1 0 0\n"
    "0 0.1 0\n"
    "0 0 0.1\n"
    "0.1 0.1 0.1\n"
    "CELLS 2 10\n"
    "4 0 1 2 3\n"
    "4 1 2 3 4\n"
    "CELL_TYPES 2\n"
    "10\n"
    "10\n";
const std::string kRegion = "CELL_DATA 2\nSCALARS region int 1\nLOOKUP_TABLE default\n1\n2\n";

std::string with(const std::string& from, const std::string& to, std::string text = kGood) {
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
}

std::string error_of(const std::string& text, bool keep_order = false) {
    const auto mesh = parse_vtk_tets(text, "mesh.vtk", keep_order);
    if (mesh) return "no error";
    EXPECT_EQ(mesh.error().kind, ErrorKind::kInvalidInput);
    return mesh.error().text;
}

TEST(VtkReader, ReadsPointsCellsAndRegion) {
    const auto mesh = parse_vtk_tets(kGood + kRegion, "mesh.vtk");
    ASSERT_TRUE(mesh) << mesh.error().text;
    EXPECT_EQ(mesh->nodes.size(), 5u);
    EXPECT_EQ(mesh->nodes[4], (Point{0.1, 0.1, 0.1}));
    ASSERT_EQ(mesh->tets.size(), 2u);
    EXPECT_EQ(mesh->tets[1], (std::array<std::int32_t, 4>{1, 2, 3, 4}));
    EXPECT_EQ(mesh->region, (std::vector<std::int32_t>{1, 2}));
    EXPECT_TRUE(parse_vtk_tets(kGood, "mesh.vtk")->region.empty());
}

TEST(VtkReader, ToleratesWhatOtherProgramsWrite) {
    EXPECT_EQ(error_of(with("double", "float")), "no error");
    EXPECT_EQ(error_of("\xEF\xBB\xBF" + kGood), "no error");
    EXPECT_EQ(error_of(with("0 0 0\n0.1 0 0\n", "0 0 0 0.1 0\n0 ")), "no error");  // any line breaks
    EXPECT_EQ(error_of(with("double\n", "double\n\n")), "no error");
    std::string windows;
    for (const char c : kGood + kRegion) windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
    const auto mesh = parse_vtk_tets(windows, "mesh.vtk");
    ASSERT_TRUE(mesh) << mesh.error().text;
    EXPECT_EQ(mesh->region.size(), 2u);
}

TEST(VtkReader, SkipsDataThatItDoesNotNeed) {
    const std::string data =
        "POINT_DATA 5\nVECTORS u double\n0 0 0 0 0 0 0 0 0 0 0 0 0 0 1e-3\n"
        "SCALARS p float\nLOOKUP_TABLE default\n0 0 nan 0 1\n"
        "FIELD FieldData 2\nage 1 5 int\n1 2 3 4 5\nuv 2 5 float\n0 0 0 0 0 0 0 0 0 0\n"
        "METADATA\nINFORMATION 0\n\n"
        "TENSORS s double\n0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 "
        "0 0 0 0\n"
        "LOOKUP_TABLE mine 2\n0 0 0 1 1 1 1 1\n";
    const auto mesh = parse_vtk_tets(kGood + data + kRegion, "mesh.vtk");
    ASSERT_TRUE(mesh) << mesh.error().text;
    EXPECT_EQ(mesh->region, (std::vector<std::int32_t>{1, 2}));
}

TEST(VtkReader, ReadsRegionFromAFieldArray) {
    const auto mesh = parse_vtk_tets(kGood + "CELL_DATA 2\nFIELD FieldData 1\nregion 1 2 int\n7 8\n", "mesh.vtk");
    ASSERT_TRUE(mesh) << mesh.error().text;
    EXPECT_EQ(mesh->region, (std::vector<std::int32_t>{7, 8}));
}

TEST(VtkReader, ReadsVersionFiveCells) {
    const std::string cells = "CELLS 3 8\nOFFSETS vtktypeint64\n0 4 8\nCONNECTIVITY vtktypeint64\n0 1 2 3 1 2 3 4\n";
    const std::string text = with("CELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\n", cells);
    const auto mesh = parse_vtk_tets(text, "mesh.vtk"), old = parse_vtk_tets(kGood, "mesh.vtk");
    ASSERT_TRUE(mesh) << mesh.error().text;
    EXPECT_EQ(mesh->tets, old->tets);
    EXPECT_EQ(error_of(with("0 4 8", "0 3 8", text)),
              "mesh.vtk:13: '3', expected offset of a tetrahedron, an integer in [4, 4]");
}

TEST(VtkReader, InvertedTetrahedronIsNamedWithItsVolume) {
    const std::string text = with("4 1 2 3 4", "4 2 1 3 4");
    EXPECT_THAT(error_of(text), HasSubstr("mesh.vtk:13: tetrahedron 1 is inverted: volume -0.000333333333 m^3"));
    const auto kept = parse_vtk_tets(text, "mesh.vtk", true);
    ASSERT_TRUE(kept) << kept.error().text;
    EXPECT_EQ(kept->tets[1], (std::array<std::int32_t, 4>{2, 1, 3, 4}));
    EXPECT_LT(signed_volume_m3(*kept, 1), 0.0);
}

TEST(VtkReader, DegenerateTetrahedronIsAnErrorInAnyOrder) {
    const std::string flat = with("0.1 0.1 0.1", "0.05 0.05 1e-12", with("4 1 2 3 4", "4 0 1 2 4"));
    EXPECT_THAT(error_of(flat), HasSubstr("mesh.vtk:13: tetrahedron 1 is degenerate: volume "));
    EXPECT_THAT(error_of(flat, true), HasSubstr("is degenerate"));
    EXPECT_THAT(error_of(with("4 1 2 3 4", "4 1 2 3 3")), HasSubstr("tetrahedron 1 is degenerate: volume 0 m^3"));
}

TEST(VtkReader, NodeIdOutOfRangeIsNamed) {
    EXPECT_EQ(error_of(with("4 1 2 3 4", "4 1 2 3 5")), "mesh.vtk:13: '5', expected a node id, an integer in [0, 4]");
    EXPECT_THAT(error_of(with("4 1 2 3 4", "4 1 2 3 -1")), HasSubstr("'-1', expected a node id"));
}

TEST(VtkReader, OtherCellsAreRefused) {
    EXPECT_EQ(error_of(with("4 1 2 3 4", "3 1 2 3 4")),
              "mesh.vtk:13: '3', expected number of nodes of a tetrahedron, an integer in [4, 4]");
    EXPECT_EQ(error_of(with("10\n10\n", "10\n12\n")),
              "mesh.vtk:16: '12', expected cell type (tetrahedra only), an integer in [10, 10]");
    EXPECT_EQ(error_of(with("CELLS 2 10", "CELLS 2 12")), "mesh.vtk:11: CELLS 2 12: size must be 10 for tetrahedra");
    EXPECT_EQ(error_of(with("CELL_TYPES 2", "CELL_TYPES 1")), "mesh.vtk:14: CELL_TYPES 1, expected 2");
}

TEST(VtkReader, HugeCountsAreRefusedBeforeTheyAreAllocated) {
    EXPECT_THAT(error_of(with("POINTS 5", "POINTS 2000000000")),
                HasSubstr("mesh.vtk:5: number of points 2000000000 is more than the rest of the file can hold"));
    EXPECT_THAT(error_of(with("POINTS 5", "POINTS 99999999999999999999")),
                HasSubstr("expected number of points, an integer in"));
    EXPECT_THAT(error_of(with("CELLS 2 10", "CELLS 400000000 2000000000")),
                HasSubstr("number of cells 400000000 is more than"));
    EXPECT_THAT(error_of(with("POINTS 5", "POINTS -5")), HasSubstr("'-5', expected number of points"));
}

TEST(VtkReader, EveryTruncationIsAnErrorOrHarmless) {
    for (std::size_t length = 0; length < kGood.size() - 1; ++length) {
        const std::string error = error_of(kGood.substr(0, length));
        EXPECT_NE(error, "no error") << "cut at " << length;
        EXPECT_THAT(error, HasSubstr("mesh.vtk:")) << "cut at " << length;
    }
    EXPECT_EQ(error_of(""), "mesh.vtk:1: empty file, expected '# vtk DataFile Version'");
}

TEST(VtkReader, NonFiniteAndUnreadableNumbersAreNamed) {
    EXPECT_EQ(error_of(with("0 0 0.1\n", "0 nan 0.1\n")), "mesh.vtk:9: 'nan', expected a coordinate, a finite number");
    EXPECT_THAT(error_of(with("0 0 0.1\n", "0 0,1 0.1\n")), HasSubstr("mesh.vtk:9: '0,1'"));
    EXPECT_THAT(error_of(with("0 0 0.1\n", "0 inf 0.1\n")), HasSubstr("'inf'"));
}

TEST(VtkReader, ForeignFilesAreNamed) {
    EXPECT_THAT(error_of("<?xml version=\"1.0\"?>\n"), HasSubstr("expected '# vtk DataFile Version ...'"));
    EXPECT_EQ(error_of(with("ASCII", "BINARY")), "mesh.vtk:3: 'BINARY', expected ASCII");
    EXPECT_EQ(error_of(with("UNSTRUCTURED_GRID", "POLYDATA")), "mesh.vtk:4: 'POLYDATA', expected UNSTRUCTURED_GRID");
    EXPECT_THAT(error_of(with("double", "int")), HasSubstr("points of type 'int', expected double or float"));
    EXPECT_THAT(error_of(kGood + kGood), HasSubstr("mesh.vtk:17: '#' is not a known section"));
    EXPECT_THAT(error_of(with("CELL_TYPES 2\n10\n10\n", "")), HasSubstr("no CELL_TYPES section"));
    EXPECT_THAT(error_of(with("CELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10\n10\n", "CELLS 0 0\nCELL_TYPES 0\n")),
                HasSubstr("mesh.vtk: no tetrahedra"));
}

TEST(VtkReader, WrongDataSectionsAreNamed) {
    EXPECT_THAT(error_of(kGood + "CELL_DATA 3\n"),
                HasSubstr("mesh.vtk:17: '3', expected number of cells, an integer in [2, 2]"));
    EXPECT_THAT(error_of(kGood + "CELL_DATA 2\nSCALARS region int 1\nLOOKUP_TABLE default\n1\n"),
                HasSubstr("truncated: expected a region number"));
    EXPECT_THAT(error_of(kGood + "CELL_DATA 2\nSCALARS region int 1\nLOOKUP_TABLE default\n1\n1.5\n"),
                HasSubstr("mesh.vtk:21: region 1.5, expected an integer"));
    EXPECT_THAT(error_of(kGood + kRegion + "SCALARS region int\nLOOKUP_TABLE default\n1 2\n"),
                HasSubstr("region appears twice"));
}

}  // namespace
}  // namespace teres
