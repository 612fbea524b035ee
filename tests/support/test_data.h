// Where tests find outside data (never copied into the tree) and scratch folders.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

namespace teres::test {

/// The folder of independent data: $TERES_TEST_DATA, else ../shared/data beside the source tree. Empty if absent.
inline std::filesystem::path data_folder() {
    const char* given = std::getenv("TERES_TEST_DATA");
    if (given != nullptr && *given != '\0') return given;
    const char* source = std::getenv("TERES_SOURCE_DIR");
    const std::filesystem::path beside =
        std::filesystem::path(source != nullptr ? source : ".") / ".." / "shared" / "data";
    return std::filesystem::exists(beside) ? std::filesystem::weakly_canonical(beside) : std::filesystem::path{};
}

/// A fresh folder below the system's temporary folder, removed at the end of the scope.
class ScratchFolder {
  public:
    ScratchFolder() {
        std::string pattern = (std::filesystem::temp_directory_path() / "teres-test-XXXXXX").string();
        path_ = mkdtemp(pattern.data());
    }
    ~ScratchFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    ScratchFolder(const ScratchFolder&) = delete;
    ScratchFolder& operator=(const ScratchFolder&) = delete;
    const std::filesystem::path& path() const { return path_; }

  private:
    std::filesystem::path path_;
};

}  // namespace teres::test

/// Skips loudly when the independent data is not on this machine.
#define TERES_REQUIRE_DATA(variable, relative)                                      \
    const std::filesystem::path variable = teres::test::data_folder() / (relative); \
    if (teres::test::data_folder().empty() || !std::filesystem::exists(variable))   \
    GTEST_SKIP() << "SKIPPED LOUDLY: independent data '" << (relative)              \
                 << "' not found; set TERES_TEST_DATA to the folder that holds it"
