// teres cut: tells the running service that tissue was parted or a ligament let go.
#include <cstdio>
#include <memory>

#include "core/bus.h"
#include "core/case/case_reader.h"
#include "core/case/geometry.h"
#include "core/clock.h"
#include "teres/cut_t.hpp"
#include "tools/commands.h"

namespace teres::tools {
namespace {

struct CutOptions {
    std::string url = kDefaultBusUrl;
    std::string case_folder;
    std::vector<std::string> release;
    std::vector<std::int32_t> tets;
    std::vector<double> ball;  // x, y, z, radius [m]
    bool now = false;
};

// Tetrahedra of the case whose centre is inside of the ball.
Result<int> add_ball(const CutOptions& options, cut_t& cut) {
    TERES_TRY_ASSIGN(const Case c, read_case(options.case_folder, {}));
    const Point centre{options.ball[0], options.ball[1], options.ball[2]};
    int found = 0;
    for (std::size_t e = 0; e < c.mesh.tets.size(); ++e) {
        Point middle{};
        for (const auto node : c.mesh.tets[e])
            for (std::size_t a = 0; a < 3; ++a) middle[a] += 0.25 * c.mesh.nodes[static_cast<std::size_t>(node)][a];
        if (norm(minus(middle, centre)) >= options.ball[3]) continue;
        cut.tet.push_back(static_cast<std::int32_t>(e));
        ++found;
    }
    if (found == 0)
        return not_usable("cut: no tetrahedron of " + options.case_folder + " has its centre within that ball");
    return found;
}

Result<int> send_cut(const CutOptions& options) {
    cut_t cut;
    cut.header.capture_stamp_us = options.now ? monotonic_us() : 0;
    cut.header.sequence = 0;
    cut.header.frame_id = "case";
    cut.released = options.release;
    cut.tet = options.tets;
    if (!options.ball.empty()) TERES_TRY(add_ball(options, cut));
    cut.num_tets = static_cast<std::int32_t>(cut.tet.size());
    cut.num_released = static_cast<std::int32_t>(cut.released.size());
    if (cut.num_tets + cut.num_released == 0)
        return invalid_input("cut: nothing to cut; give --release NAME, --tets ID,... or --ball with --case");
    TERES_TRY_ASSIGN(Bus bus, Bus::open(options.url));
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(cut.getEncodedSize()));
    cut.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    if (!bus.publish("CUT", bytes)) return host_fault("cut: cannot publish on " + options.url);
    std::printf("cut sent: %d tetrahedra, %d parameters released\n", cut.num_tets, cut.num_released);
    return kDone;
}

}  // namespace

void add_cut_command(CLI::App& app, int& exit_code) {
    auto options = std::make_shared<CutOptions>();
    CLI::App* verb =
        add_verb(app, exit_code, "cut", "Tell the running service that tissue was parted or a ligament let go",
                 "  teres cut --release ligament.r3.stiffness\n"
                 "  teres cut --case patient --ball 0.02 0.06 0.01 0.008       # metres: centre, radius\n"
                 "  teres cut --tets 120,121,340 --release ligament.r0.stiffness,ligament.r1.stiffness\n"
                 "The service goes on; its log says what was taken away (also pieces that nothing holds any more) or "
                 "why the cut\n"
                 "was refused.",
                 [options] {
                     const auto result = send_cut(*options);
                     return result ? *result : report(result.error());
                 });
    verb->add_option("--url", options->url, "LCM URL of the bus")->envname("LCM_DEFAULT_URL")->capture_default_str();
    verb->add_option("--release", options->release,
                     "parameters (names of BOUNDARY_ESTIMATE) that act on nothing any more")
        ->delimiter(',');
    verb->add_option("--tets", options->tets, "tetrahedra of mesh.vtk that are taken away")->delimiter(',');
    auto* folder =
        verb->add_option("--case", options->case_folder, "case folder whose mesh --ball means")->type_name("CASE");
    verb->add_option("--ball", options->ball, "take away tetrahedra whose centre is inside: X Y Z RADIUS [m]")
        ->expected(4)
        ->needs(folder);
    verb->add_flag("--stamp", options->now,
                   "only from frames that are captured from now on (default: with the next frame)");
}

}  // namespace teres::tools
