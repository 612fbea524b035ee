// One test for each kind of broken folder: the message names file, line and bound.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <numeric>

#include "core/case/case_reader.h"
#include "core/case/case_writer.h"
#include "core/case/text_file.h"
#include "core/case/text_writer.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using ::testing::HasSubstr;

class BadCase : public ::testing::Test {
  protected:
    void SetUp() override {
        case_ = test::clamped_block({.cells = {4, 2, 2}});
        case_.ligament_prior = {{1, 0.5}, {2, 0.7}};
        case_.tools = {{"probe", 3, 100.0}};
        case_.tool_samples = {{0.0, 0, {0.1, 0.0, 0.0}}, {0.1, 0, {0.1, 0.01, 0.0}}};
        case_.springs = {{4, {0.0, 0.0, 0.06}, SpringLaw::kCubic, {10.0, 0.0, 1e4}, 0.03, "left"}};
        ASSERT_TRUE(write_case(case_, folder()));
        ASSERT_EQ(error(), "no error");
    }
    std::filesystem::path folder() const { return scratch_.path(); }
    std::string text(const std::string& file) const { return *read_text_file(folder() / file); }
    void write(const std::string& file, const std::string& text) {
        ASSERT_TRUE(write_text_file(folder() / file, text));
    }
    void append(const std::string& file, const std::string& rows) { write(file, text(file) + rows); }
    // Changes line `number` (from 1).
    void set_line(const std::string& file, std::size_t number, const std::string& line) {
        std::istringstream in(text(file));
        std::string out, each;
        for (std::size_t i = 1; std::getline(in, each); ++i) out += (i == number ? line : each) + "\n";
        write(file, out);
    }
    void rewrite(const std::function<void(Case&)>& change) {
        change(case_);
        ASSERT_TRUE(write_case(case_, folder()));
    }
    std::string error(const CaseReadOptions& options = {}) const {
        const auto c = read_case(folder(), options);
        if (c) return "no error";
        EXPECT_EQ(c.error().kind, ErrorKind::kInvalidInput);
        // the folder's name is of no interest here
        std::string text = c.error().text;
        const std::string prefix = folder().string() + "/";
        for (auto at = text.find(prefix); at != std::string::npos; at = text.find(prefix))
            text.erase(at, prefix.size());
        return text;
    }

    test::ScratchFolder scratch_;
    Case case_;
};

TEST_F(BadCase, MissingFilesAreNamed) {
    for (const char* file : {"case.json", "mesh.vtk", "markers_rest.csv", "observations.csv"}) {
        const std::string kept = text(file);
        std::filesystem::remove(folder() / file);
        EXPECT_EQ(error(), std::string(file) + ": file not found");
        write(file, kept);
    }
    EXPECT_THAT(read_case(folder() / "nowhere").error().text, HasSubstr("not a folder"));
    EXPECT_THAT(read_case(folder() / "case.json").error().text, HasSubstr("not a folder"));
}

TEST_F(BadCase, AbsentOptionalFilesMeanAbsentThings) {
    for (const char* file : {"clamped.csv", "ligament_prior.csv", "loads.csv", "load_nodes.csv", "tool.csv",
                             "tool_nodes.csv", "springs.csv", "validation_rest.csv"})
        std::filesystem::remove(folder() / file);
    const auto c = read_case(folder());
    ASSERT_TRUE(c) << c.error().text;
    EXPECT_TRUE(c->loads.empty() && c->load_regions.empty() && c->springs.empty() && c->tools.empty());
}

TEST_F(BadCase, EmptyFilesAreNamed) {
    for (const char* file :
         {"case.json", "mesh.vtk", "clamped.csv", "ligament_prior.csv", "load_nodes.csv", "loads.csv", "tool_nodes.csv",
          "tool.csv", "springs.csv", "markers_rest.csv", "observations.csv", "validation_rest.csv"}) {
        const std::string kept = text(file);
        write(file, "");
        EXPECT_THAT(error(), HasSubstr(std::string(file) + ":1: empty file")) << file;
        write(file, kept);
    }
}

TEST_F(BadCase, FolderInPlaceOfAFileIsNamed) {
    std::filesystem::remove(folder() / "loads.csv");
    std::filesystem::create_directory(folder() / "loads.csv");
    EXPECT_EQ(error(), "loads.csv: not a regular file");
}

TEST_F(BadCase, EveryTruncationOfEveryTableIsFound) {
    for (const char* file :
         {"load_nodes.csv", "loads.csv", "tool.csv", "springs.csv", "markers_rest.csv", "observations.csv"}) {
        const std::string whole = text(file);
        // every cut inside a row; a cut behind a line end leaves a shorter but well-formed table
        for (std::size_t length = 1; length < whole.size(); length += 7) {
            if (whole[length - 1] == '\n') continue;
            write(file, whole.substr(0, length));
            EXPECT_THAT(error(), HasSubstr(file)) << "cut at " << length;
        }
        write(file, whole);
    }
}

TEST_F(BadCase, WindowsLineEndsAndByteOrderMarksAreRead) {
    for (const auto& entry : std::filesystem::directory_iterator(folder())) {
        const std::string file = entry.path().filename().string();
        std::string windows = "\xEF\xBB\xBF";
        for (const char ch : text(file)) windows += ch == '\n' ? std::string("\r\n") : std::string(1, ch);
        write(file, windows);
    }
    EXPECT_EQ(error(), "no error");
}

TEST_F(BadCase, InvertedTetrahedronIsNamed) {
    rewrite([](Case& c) { std::swap(c.mesh.tets[7][0], c.mesh.tets[7][1]); });
    EXPECT_THAT(error(), HasSubstr("tetrahedron 7 is inverted: volume -"));
}

TEST_F(BadCase, DisconnectedMeshNamesThePieces) {
    rewrite([](Case& c) {
        const TetMeshData other = test::block_mesh({0.02, 0.02, 0.02}, {1, 1, 1});
        const auto offset = static_cast<std::int32_t>(c.mesh.nodes.size());
        for (const Point& node : other.nodes) c.mesh.nodes.push_back(plus(node, {0.2, 0.0, 0.0}));
        for (auto tet : other.tets) {
            for (auto& id : tet) id += offset;
            c.mesh.tets.push_back(tet);
        }
    });
    EXPECT_EQ(error(), "mesh.vtk: the mesh falls into 2 pieces of 45, 8 nodes, expected 1");
}

TEST_F(BadCase, NodeInNoTetrahedronIsNamed) {
    rewrite([](Case& c) { c.mesh.nodes.push_back({0.0, 0.0, 0.0}); });
    EXPECT_EQ(error(), "mesh.vtk: node 45 is in no tetrahedron (1 such nodes)");
}

TEST_F(BadCase, OverlappingTetrahedraAreNamed) {
    rewrite([](Case& c) { c.mesh.tets.push_back(c.mesh.tets[5]); });
    EXPECT_THAT(error(), HasSubstr("mesh.vtk: tetrahedra 5 and 96 overlap: both lie on the same side of face "));
}

TEST_F(BadCase, MillimetresAreRecognised) {
    rewrite([](Case& c) {
        for (Point& node : c.mesh.nodes) node = times(1e3, node);
    });
    EXPECT_THAT(
        error(),
        HasSubstr("mesh.vtk: the body is 100 m long, at most 5 m is allowed; are the coordinates in millimetres?"));
}

TEST_F(BadCase, NodeIdsOutsideTheMeshAreNamed) {
    append("clamped.csv", "45\n");
    EXPECT_THAT(error(), HasSubstr("clamped.csv:11: node_id 45 is outside the mesh, which has 45 nodes"));
    rewrite([](Case&) {});
    append("ligament_prior.csv", "99,0.5\n");
    EXPECT_THAT(error(), HasSubstr("ligament_prior.csv:4: node_id 99 is outside the mesh"));
    rewrite([](Case&) {});
    append("load_nodes.csv", "tip,1000,0.0\n");
    EXPECT_THAT(error(), HasSubstr("node_id 1000 is outside the mesh"));
    rewrite([](Case&) {});
    append("springs.csv", "45,0,0,0,linear,1,0,0,0,a\n");
    EXPECT_THAT(error(), HasSubstr("springs.csv:3: node_id 45 is outside the mesh"));
    rewrite([](Case&) {});
    append("tool_nodes.csv", "probe,45,1\n");
    EXPECT_THAT(error(), HasSubstr("tool_nodes.csv:3: node_id 45 is outside the mesh"));
}

TEST_F(BadCase, DuplicateIdsAreNamed) {
    append("clamped.csv", "0\n");
    EXPECT_EQ(error(), "clamped.csv:11: node_id 0 appears twice");
    rewrite([](Case&) {});
    append("ligament_prior.csv", "1,0.5\n");
    EXPECT_EQ(error(), "ligament_prior.csv:4: node_id 1 appears twice");
    rewrite([](Case&) {});
    append("load_nodes.csv", "tip," + std::to_string(case_.load_regions[0].node_ids[0]) + ",0\n");
    EXPECT_THAT(error(), HasSubstr("appears twice in region 'tip'"));
    rewrite([](Case&) {});
    append("markers_rest.csv", "0,0.05,0.01,0.03\n");
    EXPECT_EQ(error(), "markers_rest.csv:10: id 0 appears twice");
    rewrite([](Case&) {});
    append("validation_rest.csv", "3,0.05,0.01,0.03\n");
    EXPECT_EQ(error(), "validation_rest.csv:10: id 3 appears twice");
    rewrite([](Case&) {});
    append("observations.csv", "0.4,2,0.05,0.01,0.03\n");
    EXPECT_EQ(error(), "observations.csv:42: id 2 appears twice at t_s = 0.4");
}

TEST_F(BadCase, WeightsMustSumToOne) {
    rewrite([](Case& c) { c.load_regions[0].weights[0] += 0.002; });
    EXPECT_EQ(error(), "load_nodes.csv:2: weights of region 'tip' sum to 1.002, expected 1 +- 0.001");
    rewrite([](Case& c) { c.load_regions[0].weights[0] -= 0.0015; });
    EXPECT_EQ(error(), "no error");
    rewrite([](Case& c) { c.load_regions[0].weights[0] = -0.1; });
    EXPECT_EQ(error(), "load_nodes.csv:2: weight -0.1 is below 0");
}

TEST_F(BadCase, LoadOnAnUnknownRegionIsNamed) {
    append("loads.csv", "1,tpi,0,0,0\n");
    EXPECT_EQ(error(), "loads.csv:7: region 'tpi' is not in load_nodes.csv");
}

TEST_F(BadCase, UnknownToolIsNamed) {
    append("tool.csv", "1,hook,0,0,0\n");
    EXPECT_EQ(error(), "tool.csv:4: tool 'hook' is not in tool_nodes.csv");
    rewrite([](Case& c) { c.tools[0].stiffness_n_per_m = -1.0; });
    EXPECT_EQ(error(), "tool_nodes.csv:2: stiffness_n_per_m -1 is below 0");
}

TEST_F(BadCase, ProbabilityOutsideTheUnitIntervalIsNamed) {
    set_line("ligament_prior.csv", 3, "2,1.0001");
    EXPECT_EQ(error(), "ligament_prior.csv:3: probability 1.0001 is outside [0, 1]");
    set_line("ligament_prior.csv", 3, "2,-0.1");
    EXPECT_EQ(error(), "ligament_prior.csv:3: probability -0.1 is outside [0, 1]");
    set_line("ligament_prior.csv", 3, "2,nan");
    EXPECT_EQ(error(), "ligament_prior.csv:3: probability = 'nan', expected a finite number");
}

TEST_F(BadCase, SpringsAreChecked) {
    set_line("springs.csv", 2, "4,0,0,0.06,cubik,10,0,1,0.03,left");
    EXPECT_EQ(error(), "springs.csv:2: law 'cubik', expected linear|rest_shape|cubic|polynomial");
    set_line("springs.csv", 2, "4,0,0,0.06,cubic,-10,0,1,0.03,left");
    EXPECT_EQ(error(), "springs.csv:2: k1 = -10 is below 0");
    set_line("springs.csv", 2, "4,0,0,0.06,cubic,10,0,1,-0.03,left");
    EXPECT_EQ(error(), "springs.csv:2: rest_length_m = -0.03 is below 0");
    set_line("springs.csv", 2, "4,0,0,0.06,polynomial,10,0,1,0,left");
    EXPECT_EQ(error(), "springs.csv:2: rest_length_m = 0, must be above 0 for law polynomial");
}

TEST_F(BadCase, MarkerOffTheSurfaceIsNamed) {
    set_line("markers_rest.csv", 4, "2,0.05,0.01,0.08");  // 5 cm above the top face
    EXPECT_EQ(error(), "markers_rest.csv:4: marker 2 is 0.05 m off the surface, at most 0.02 m is allowed");
    CaseReadOptions wider;
    wider.max_marker_distance_m = 0.06;
    EXPECT_EQ(error(wider), "no error");
}

TEST_F(BadCase, ZeroMarkersAreAnError) {
    write("markers_rest.csv", "marker_id,x_m,y_m,z_m\n");
    EXPECT_EQ(error(), "markers_rest.csv:1: no markers, at least 1 is needed");
}

TEST_F(BadCase, ZeroLoadsAreAllowed) {
    rewrite([](Case& c) {
        c.loads.clear();
        c.load_regions.clear();
    });
    EXPECT_EQ(error(), "no error");
}

TEST_F(BadCase, TimeMustNotGoBackwards) {
    append("observations.csv", "0.3,0,0.05,0.01,0.03\n");
    EXPECT_EQ(error(), "observations.csv:42: t_s = 0.3 goes backwards: the row before has 0.4");
    rewrite([](Case&) {});
    append("loads.csv", "0.1,tip,0,0,0\n");
    EXPECT_EQ(error(), "loads.csv:7: t_s = 0.1 goes backwards: the row before has 0.4");
    rewrite([](Case&) {});
    append("tool.csv", "0,probe,0,0,0\n");
    EXPECT_EQ(error(), "tool.csv:4: t_s = 0 goes backwards: the row before has 0.1");
}

TEST_F(BadCase, ObservationsOfUnknownMarkersAreNamed) {
    append("observations.csv", "0.5,77,0.05,0.01,0.03\n");
    EXPECT_EQ(error(), "observations.csv:42: marker_id 77 is not in markers_rest.csv");
}

TEST_F(BadCase, ObservationsThatAreAllLostAreAnError) {
    rewrite([](Case& c) {
        for (auto& sample : c.observations) sample.position_m.fill(std::numeric_limits<double>::quiet_NaN());
    });
    EXPECT_EQ(error(), "observations.csv: all 40 rows are NaN");
}

TEST_F(BadCase, PartlyLostPositionIsNamed) {
    set_line("observations.csv", 5, "0,3,NaN,0.01,0.03");
    EXPECT_EQ(error(), "observations.csv:5: 1 of 3 coordinates are NaN; a lost point has NaN in all three");
}

TEST_F(BadCase, ObservationsInMillimetresAreNamed) {
    set_line("observations.csv", 5, "0,3,30000,10,30");
    EXPECT_EQ(error(), "observations.csv:5: coordinate 30000 m is outside +-1000 m");
}

TEST_F(BadCase, MarkersAtRestMustBeKnown) {
    set_line("markers_rest.csv", 4, "2,NaN,NaN,NaN");
    EXPECT_EQ(error(), "markers_rest.csv:4: x_m = 'NaN', expected a finite number");
}

TEST_F(BadCase, StreamReplacesObservationsButMustExist) {
    rewrite([](Case& c) {
        c.stream = "run.lcm";
        c.observations.clear();
    });
    EXPECT_THAT(error(), HasSubstr("case.json: stream: run.lcm not found"));
    write("run.lcm", "log");
    EXPECT_EQ(error(), "no error");
}

TEST_F(BadCase, ObservationsAreLeftOutOnRequest) {
    std::filesystem::remove(folder() / "observations.csv");
    CaseReadOptions without;
    without.observations = false;
    EXPECT_EQ(error(without), "no error");
}

// `estimate` and `diagnose` must not open the truth: a folder whose validation.csv cannot even be parsed
// reads well.
TEST_F(BadCase, ValidationTruthIsNeverOpened) {
    write("validation.csv", "garbage");
    EXPECT_EQ(error(), "no error");
}

}  // namespace
}  // namespace teres
