// Augmented view of a 640x480 frame: drawn, and drawn and compressed. Budget: 5 ms on one core.
#include <benchmark/benchmark.h>

#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "core/case/case_reader.h"
#include "plugins/overlay/overlay.h"

namespace teres {
namespace {

void BM_OverlayVga(benchmark::State& state) {
    const char* source = std::getenv("TERES_SOURCE_DIR");
    const auto c = read_case(std::string(source != nullptr ? source : ".") + "/config/cases/demo");
    if (!c) return state.SkipWithError(c.error().text.c_str());
    std::vector<StructurePoint> structures;
    for (const MarkerRest& p : c->validation_rest) structures.push_back({std::to_string(p.id), p.position_m, 0.003});
    Overlay overlay(c->mesh, structures, {});
    overlay.set_camera({640, 480, 612.0, 611.0, 322.5, 241.0, {0.02, -0.05, 5e-4, -3e-4, 0.0}},
                       *camera_pose(c->sensor));
    cv::Mat camera(480, 640, CV_8UC3);
    cv::randn(camera, cv::Scalar(90, 100, 110), cv::Scalar::all(6));  // grey levels of sensor noise
    cv::Mat frame;
    std::vector<std::uint8_t> bytes;
    for (auto _ : state) {
        camera.copyTo(frame);
        overlay.draw(frame, false);
        if (state.range(0) > 0)
            cv::imencode(".jpg", frame, bytes, {cv::IMWRITE_JPEG_QUALITY, static_cast<int>(state.range(0))});
        benchmark::DoNotOptimize(frame.data);
    }
}
BENCHMARK(BM_OverlayVga)->ArgName("jpeg_quality")->Arg(0)->Arg(85)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace teres

BENCHMARK_MAIN();
