#include "tools/calculix/solver.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <utility>

namespace teres::calculix {
namespace {

// A number of a fixed column; Fortran drops the E of a three-digit exponent.
double fortran_number(std::string text) {
    const std::size_t sign = text.find_last_of("+-");
    if (sign != std::string::npos && sign > 0 && std::isdigit(static_cast<unsigned char>(text[sign - 1])) != 0) {
        text.insert(sign, "E");
    }
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    return end == text.c_str() + text.size() && !text.empty() ? value : std::nan("");
}

std::string read_text(const std::filesystem::path& path) {
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

}  // namespace

std::string number(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.12g", value);
    return text;
}

std::string material_card(const CalculixMaterial& m, const std::string& name, const std::string& set) {
    using Law = CalculixMaterial::Law;
    const std::string volumetric = number(2.0 / m.bulk_modulus_pa());  // D1 = 2/K
    std::string text = "*MATERIAL, NAME=" + name + "\n";
    switch (m.law) {
        case Law::kLinear:
            text += "*ELASTIC\n" + number(m.youngs_modulus_pa) + ", " + number(m.poissons_ratio) + "\n";
            if (m.creep_per_pa_s > 0.0) text += "*CREEP, LAW=NORTON\n" + number(m.creep_per_pa_s) + ", 1., 0.\n";
            break;
        case Law::kNeoHookean:  // C10 = G/2
            text += "*HYPERELASTIC, NEO HOOKE\n" + number(0.5 * m.shear_modulus_pa()) + ", " + volumetric + "\n";
            break;
        case Law::kYeoh:  // C10 = G/2, C20, C30; large D2 and D3 leave the volume law linear
            text += "*HYPERELASTIC, YEOH\n" + number(0.5 * m.shear_modulus_pa()) + ", " + number(m.yeoh_c20_pa) + ", " +
                    number(m.yeoh_c30_pa) + ", " + volumetric + ", 1., 1.\n";
            break;
        case Law::kOgden:  // mu1 = G
            text += "*HYPERELASTIC, OGDEN, N=1\n" + number(m.shear_modulus_pa()) + ", " + number(m.alpha) + ", " +
                    volumetric + "\n";
            break;
    }
    if (m.density_kg_m3 > 0.0) text += "*DENSITY\n" + number(m.density_kg_m3) + "\n";
    return text + "*SOLID SECTION, ELSET=" + set + ", MATERIAL=" + name + "\n";
}

bool calculix_available() {
    return std::system("ccx -v > /dev/null 2>&1; test $? -ne 127") == 0;
}

Result<CalculixRun> run_calculix(const std::filesystem::path& folder, const std::string& job, int threads,
                                 double limit_s) {
    if (!calculix_available()) return host_fault("program 'ccx' not found; apt-get install calculix-ccx");
    const auto start = std::chrono::steady_clock::now();
    // The limit is on processor time: a busy machine makes a run later, not another.
    const std::string command =
        "cd '" + folder.string() + "' && ulimit -t " + std::to_string(static_cast<long>(std::ceil(limit_s * threads))) +
        " && OMP_NUM_THREADS=" + std::to_string(threads) + " nice -n 10 ccx -i " + job + " > " + job + ".log 2>&1";
    const int code = std::system(command.c_str());
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    const std::string log = read_text(folder / (job + ".log"));
    if (code != 0 || log.find("*ERROR") != std::string::npos || log.find("Job finished") == std::string::npos) {
        return not_usable("ccx failed; its last words:\n" + log.substr(log.size() > 1500 ? log.size() - 1500 : 0));
    }
    return CalculixRun{elapsed.count(), read_text(folder / (job + ".dat"))};
}

Result<std::vector<CalculixBlock>> read_blocks(const std::string& dat, const std::string& title) {
    std::vector<CalculixBlock> blocks;
    std::istringstream lines(dat);
    std::string line;
    bool inside = false;
    while (std::getline(lines, line)) {
        if (line.compare(0, title.size() + 1, " " + title) == 0) {
            const std::size_t stamp = line.rfind("time");
            blocks.push_back({stamp == std::string::npos ? 0.0 : std::strtod(line.c_str() + stamp + 4, nullptr), {}});
            inside = true;
            continue;
        }
        if (!inside) continue;
        if (line.find_first_not_of(" \r") == std::string::npos) {
            inside = blocks.back().rows.empty();
            continue;
        }
        // Fixed columns: I10, then 14 characters per number.
        if (line.size() < 10 + 3 * 14) return not_usable("short row in the .dat file: '" + line + "'");
        Point values{};
        for (std::size_t i = 0; i < 3; ++i) {
            std::string field = line.substr(10 + 14 * i, 14);
            field.erase(std::remove(field.begin(), field.end(), ' '), field.end());
            values[i] = fortran_number(field);
            if (!std::isfinite(values[i])) return not_usable("not a number in the .dat file: '" + line + "'");
        }
        blocks.back().rows[static_cast<std::int32_t>(std::strtol(line.substr(0, 10).c_str(), nullptr, 10)) - 1] =
            values;
    }
    return blocks;
}

Result<std::map<std::int32_t, Point>> last_block(const std::string& dat, const std::string& title) {
    TERES_TRY_ASSIGN(std::vector<CalculixBlock> blocks, read_blocks(dat, title));
    if (blocks.empty()) return not_usable("no block '" + title + "' in the .dat file");
    return std::move(blocks.back().rows);
}

}  // namespace teres::calculix
