#include "core/case/vtk_writer.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/case/text_file.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

struct Written {
    std::vector<double> points, displacement, probability, part, tension;
    std::vector<int> cell_types, line_nodes;
};

// A reader of its own for exactly this layout, so that the writer is not checked by our own parser.
Written read_back(const std::filesystem::path& file) {
    std::ifstream stream(file);
    std::stringstream in;
    in << stream.rdbuf();
    std::string word, line;
    std::getline(in, line);
    std::getline(in, line);
    Written out;
    std::size_t points = 0, cells = 0, data = 0;
    const auto read = [&](std::vector<double>& to, std::size_t n) {
        to.resize(n);
        for (double& x : to) in >> x;
    };
    std::vector<double> ignored;
    while (in >> word) {
        if (word == "POINTS") {
            in >> points >> word;
            read(out.points, 3 * points);
        } else if (word == "CELLS") {
            std::size_t size = 0;
            in >> cells >> size;
            std::size_t words = 0;
            for (std::size_t i = 0; i < cells; ++i) {
                std::size_t n = 0;
                in >> n;
                words += n + 1;
                for (std::size_t k = 0; k < n; ++k) {
                    int id = 0;
                    in >> id;
                    if (n == 2) out.line_nodes.push_back(id);
                }
            }
            EXPECT_EQ(words, size);
        } else if (word == "CELL_TYPES") {
            in >> cells;
            out.cell_types.resize(cells);
            for (int& type : out.cell_types) in >> type;
        } else if (word == "POINT_DATA" || word == "CELL_DATA") {
            in >> data;
        } else if (word == "VECTORS") {
            in >> word >> word;
            read(out.displacement, 3 * data);
        } else if (word == "SCALARS") {
            std::string name;
            in >> name >> word >> word >> word >> word;
            auto* to = name == "attachment_probability" ? &out.probability
                       : name == "part"                 ? &out.part
                       : name == "tension_n"            ? &out.tension
                                                        : &ignored;
            read(*to, data);
        }
    }
    return out;
}

TEST(VtkSeries, FrameHoldsBodySpringsAndData) {
    const test::ScratchFolder scratch;
    const TetMeshData mesh = test::block_mesh({0.1, 0.03, 0.03}, {2, 1, 1});
    std::vector<double> positions;
    for (const Point& node : mesh.nodes) positions.insert(positions.end(), {node[0], node[1], node[2] + 0.001});
    std::vector<double> probability(mesh.nodes.size(), 0.0);
    probability[3] = 0.75;
    const std::vector<VtkSpring> springs{{3, {0.0, 0.03, 0.06}, 85.0, 0.4}};

    auto series = VtkSeries::make(scratch.path() / "out", "body", mesh);
    ASSERT_TRUE(series) << series.error().text;
    for (const double t_s : {0.0, 0.2}) ASSERT_TRUE(series->add({t_s, positions, probability, springs}));
    const auto path = series->finish();
    ASSERT_TRUE(path) << path.error().text;

    const auto json = nlohmann::json::parse(*read_text_file(*path));
    EXPECT_EQ(json["file-series-version"], "1.0");
    ASSERT_EQ(json["files"].size(), 2u);
    EXPECT_EQ(json["files"][1]["name"], "body_0001.vtk");
    EXPECT_EQ(json["files"][1]["time"], 0.2);

    const Written frame = read_back(scratch.path() / "out" / "body_0001.vtk");
    ASSERT_EQ(frame.points.size(), 3 * (mesh.nodes.size() + 1));
    EXPECT_EQ(frame.points[2], mesh.nodes[0][2] + 0.001);
    EXPECT_EQ(frame.points[3 * mesh.nodes.size() + 2], 0.06);
    ASSERT_EQ(frame.displacement.size(), frame.points.size());
    EXPECT_NEAR(frame.displacement[5], 0.001, 1e-15);
    ASSERT_EQ(frame.cell_types.size(), mesh.tets.size() + 1);
    EXPECT_EQ(frame.cell_types.front(), 10);
    EXPECT_EQ(frame.cell_types.back(), 3);
    EXPECT_EQ(frame.line_nodes, (std::vector<int>{3, static_cast<int>(mesh.nodes.size())}));
    ASSERT_EQ(frame.probability.size(), mesh.nodes.size() + 1);
    EXPECT_EQ(frame.probability[3], 0.75);
    EXPECT_EQ(frame.part.back(), 1.0);
    EXPECT_EQ(frame.part.front(), 0.0);
    EXPECT_EQ(frame.tension.back(), 0.4);
}

TEST(VtkSeries, RefusesWrongSizes) {
    const test::ScratchFolder scratch;
    const TetMeshData mesh = test::block_mesh({0.1, 0.03, 0.03}, {2, 1, 1});
    auto series = VtkSeries::make(scratch.path(), "body", mesh);
    ASSERT_TRUE(series);
    const std::vector<double> good(3 * mesh.nodes.size(), 0.0), bad(5, 0.0);
    const std::vector<VtkSpring> off_mesh{{99, {}, 1.0, 0.0}};
    EXPECT_FALSE(series->add({0.0, bad, {}, {}}));
    EXPECT_FALSE(series->add({0.0, good, bad, {}}));
    const auto status = series->add({0.0, good, {}, off_mesh});
    ASSERT_FALSE(status);
    EXPECT_NE(status.error().text.find("node 99, the mesh has 12"), std::string::npos) << status.error().text;
    EXPECT_TRUE(series->add({0.0, good, {}, {}}));
}

}  // namespace
}  // namespace teres
