#include "tools/liver_picture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "core/case/case_reader.h"
#include "core/case/geometry.h"
#include "tests/support/synthetic_case.h"
#include "tests/support/test_data.h"

namespace teres::tools {
namespace {

using ::testing::HasSubstr;

// Pixels of the body (above the legend) that are clearly blue: high value.
int blue_pixels(const cv::Mat& image, const cv::Rect& part) {
    int count = 0;
    const cv::Mat view = image(part);
    for (int y = 0; y < view.rows; ++y)
        for (int x = 0; x < view.cols; ++x) {
            const cv::Vec3b& p = view.at<cv::Vec3b>(y, x);
            count += p[0] > p[2] + 60 ? 1 : 0;
        }
    return count;
}

class LiverPictureOfABlock : public ::testing::Test {
  protected:
    LiverPictureOfABlock() : mesh(test::block_mesh({0.2, 0.1, 0.1}, {8, 4, 4})) {
        picture.title = "block";
        for (const Point& node : mesh.nodes) picture.value.push_back(node[2] == 0.1 ? 1.0 : 0.0);  // front face
        picture.views = {{"front", {0, 0, 1}, {0, 1, 0}}, {"back", {0, 0, -1}, {0, 1, 0}}};
    }
    cv::Mat draw() {
        const auto file = scratch.path() / "block.png";
        const auto status = save_liver_picture(picture, mesh, file);
        EXPECT_TRUE(status) << status.error().text;
        return cv::imread(file.string());
    }
    test::ScratchFolder scratch;
    TetMeshData mesh;
    LiverPicture picture;
};

TEST_F(LiverPictureOfABlock, FrontHidesBack) {
    const cv::Mat image = draw();
    ASSERT_GE(image.cols, 1400);
    const int half = image.cols / 2, height = image.rows - 120;
    EXPECT_GT(blue_pixels(image, {0, 0, half, height}), 50000);   // the front face is all high
    EXPECT_LT(blue_pixels(image, {half, 0, half, height}), 500);  // and not seen from behind
}

TEST_F(LiverPictureOfABlock, OutlineAddsItsLine) {
    const cv::Mat without = draw();
    for (std::size_t node = 0; node < mesh.nodes.size(); ++node)
        if (mesh.nodes[node][2] == 0.1 && mesh.nodes[node][0] < 0.11)
            picture.outline_nodes.push_back(static_cast<int>(node));
    const cv::Mat with = draw();
    const cv::Rect front(0, 100, with.cols / 2, with.rows - 220);
    cv::Mat difference;
    cv::absdiff(without(front), with(front), difference);
    EXPECT_GT(cv::countNonZero(difference.reshape(1)), 3000);
}

TEST_F(LiverPictureOfABlock, WrongInputIsAnErrorNotACrash) {
    const auto file = scratch.path() / "p.png";
    picture.views[0].from = {0, 0, 0};
    EXPECT_THAT(save_liver_picture(picture, mesh, file).error().text, HasSubstr("view 'front' has no direction"));
    picture.views[0] = {"up along view", {0, 1, 0}, {0, 1, 0}};
    EXPECT_TRUE(save_liver_picture(picture, mesh, file));
    picture.value.pop_back();
    EXPECT_THAT(save_liver_picture(picture, mesh, file).error().text, HasSubstr("224 values for 225 nodes"));
}

TEST_F(LiverPictureOfABlock, SecondViewFacesTheAttachment) {
    std::vector<double> right_face;
    for (const Point& node : mesh.nodes) right_face.push_back(node[0] == 0.2 ? 1.0 : 0.0);
    const auto views = default_views(mesh, {}, right_face);
    ASSERT_EQ(views.size(), 2u);
    EXPECT_GT(views[1].from[0] / norm(views[1].from), 0.95);
    SensorData sensor;
    sensor.view_direction = Point{0.0, -1.0, 0.0};
    EXPECT_EQ(default_views(mesh, sensor, right_face)[0].from[1], 1.0);
}

TEST(LiverPicture, DrawsTheControlCase) {
    TERES_REQUIRE_DATA(folder, "febio/control");
    const auto c = read_case(folder);
    ASSERT_TRUE(c) << c.error().text;
    LiverPicture picture;
    picture.value.assign(c->mesh.nodes.size(), 0.0);
    for (const auto& node : c->ligament_prior) picture.value[static_cast<std::size_t>(node.node_id)] = node.probability;
    picture.views = default_views(c->mesh, c->sensor, picture.value);
    const test::ScratchFolder scratch;
    const auto file = scratch.path() / "liver.png";
    ASSERT_TRUE(save_liver_picture(picture, c->mesh, file));
    const cv::Mat image = cv::imread(file.string());
    for (const int left : {0, image.cols / 2})  // the band shows in both views
        EXPECT_GT(blue_pixels(image, {left, 100, image.cols / 2, image.rows - 220}), 2000);
}

}  // namespace
}  // namespace teres::tools
