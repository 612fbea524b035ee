// Every way in which a plugin file can be broken is an error that names the file, what was found and what is
// needed.
#include "core/plugin_host.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <fstream>
#include <random>

#include "tests/core/plugins/test_plugins.h"
#include "tests/support/test_data.h"

namespace teres {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

std::string load_error(const std::string& id, ErrorKind kind = ErrorKind::kInvalidInput,
                       std::chrono::milliseconds limit = kProbeLimit) {
    const auto file = id == "hangs" ? test::plugin_folder() / "hangs/teres_hangs.so" : test::plugin_file(id);
    EXPECT_TRUE(std::filesystem::exists(file)) << file;
    const auto plugin = load_plugin(file, limit);
    if (plugin) return "";
    EXPECT_EQ(plugin.error().kind, kind) << plugin.error().text;
    EXPECT_THAT(plugin.error().text, StartsWith(file.string()));
    return plugin.error().text;
}

std::string read_bytes(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

TEST(PluginHost, PlainPluginLoads) {
    const auto plugin = load_plugin(test::plugin_file("plain"));
    ASSERT_TRUE(plugin) << plugin.error().text;
    EXPECT_EQ(plugin->name, "plain");
    EXPECT_EQ(plugin->version, "1.2.3");
    EXPECT_EQ(plugin->api_major, TERES_API_MAJOR);
    ASSERT_NE(plugin->factory("plain"), nullptr);
    EXPECT_EQ(plugin->factory("other"), nullptr);
}

TEST(PluginHost, EntryOfSdkIsReadableWithoutRunningCode) {
    const auto entry = read_elf_entry(test::plugin_file("life"));
    ASSERT_TRUE(entry) << entry.error().text;
    EXPECT_EQ(entry->magic, TERES_PLUGIN_MAGIC);
    EXPECT_EQ(entry->struct_size, sizeof(teres_plugin_entry_t));
    EXPECT_EQ(entry->api_major, TERES_API_MAJOR);
    EXPECT_EQ(entry->api_minor, TERES_API_MINOR);
}

TEST(PluginHost, OtherMajorIsRefused) {
    EXPECT_THAT(load_error("newer_major"), HasSubstr("built for plugin API 2.0, this host offers 1.0; rebuild"));
    EXPECT_THAT(load_error("older_major"), HasSubstr("built for plugin API 0.0, this host offers 1.0; rebuild"));
}

TEST(PluginHost, NewerMinorIsRefused) {
    EXPECT_THAT(load_error("newer_minor"),
                HasSubstr("built for plugin API 1.1, this host offers 1.0; install a newer Teres"));
}

TEST(PluginHost, MinorUpToTheHostsIsAccepted) {
    for (int minor = TERES_API_MINOR; minor >= 0; --minor)
        EXPECT_TRUE(check_version("x.so", {TERES_PLUGIN_MAGIC, sizeof(teres_plugin_entry_t), TERES_API_MAJOR,
                                           static_cast<std::uint16_t>(minor)}));
}

TEST(PluginHost, WrongMagicIsRefused) {
    EXPECT_THAT(load_error("wrong_magic"), HasSubstr("magic 0x12345678 where 0x53455254 is needed"));
}

TEST(PluginHost, MissingSymbolIsRefused) {
    EXPECT_THAT(load_error("no_symbol"), HasSubstr("exports no symbol teres_plugin_entry"));
}

TEST(PluginHost, ShortEntryIsRefused) {
    EXPECT_THAT(load_error("short_entry"), HasSubstr("entry of 16 bytes, 40 are needed"));
}

TEST(PluginHost, EntryThatCodeFillsIsRefused) {
    EXPECT_THAT(load_error("filled_at_run_time"), HasSubstr("is not constant data"));
}

TEST(PluginHost, BrokenTablesAreRefused) {
    EXPECT_THAT(load_error("no_factory"), HasSubstr("0 factories, needed are 1 to 64"));
    EXPECT_THAT(load_error("no_step"),
                HasSubstr("unit plain: create, configure, start, step, stop and destroy are all needed"));
    EXPECT_THAT(load_error("bad_default"), HasSubstr("setting gain has a default outside of its range"));
    EXPECT_THAT(load_error("null_key"), HasSubstr("a setting has no key"));
}

TEST(PluginHost, CrashInStaticConstructorStaysInTheChild) {
    EXPECT_THAT(load_error("crashes"), HasSubstr("crashed with signal 11"));
}

TEST(PluginHost, HangInStaticConstructorEndsWithTheLimit) {
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_THAT(load_error("hangs", ErrorKind::kInvalidInput, 300ms), HasSubstr("hung for more than 300 ms"));
    EXPECT_LT(std::chrono::steady_clock::now() - begin, 5s);
    EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "a child is left behind";
}

TEST(PluginHost, ExitInStaticConstructorStaysInTheChild) {
    EXPECT_THAT(load_error("exits"), HasSubstr("ended its process with exit code 7"));
}

TEST(PluginHost, MissingLibraryIsAHostFault) {
    EXPECT_THAT(load_error("missing_library", ErrorKind::kHostFault),
                AllOf(HasSubstr("libteres_test_absent.so"), HasSubstr("install the missing library")));
}

TEST(PluginHost, FileThatIsNoElfIsRefused) {
    test::ScratchFolder scratch;
    const auto file = scratch.path() / "teres_text.so";
    std::ofstream(file) << "#!/bin/sh\necho no\n";
    EXPECT_EQ(load_plugin(file).error().text, file.string() + ": not an ELF shared object");
    std::ofstream(scratch.path() / "teres_empty.so");
    EXPECT_THAT(load_plugin(scratch.path() / "teres_empty.so").error().text, HasSubstr("not an ELF shared object"));
    EXPECT_THAT(load_plugin(scratch.path()).error().text, HasSubstr("not an ELF shared object"));
    EXPECT_THAT(load_plugin(scratch.path() / "none.so").error().text, HasSubstr("cannot be opened"));
    EXPECT_THAT(load_plugin("/proc/self/exe").error().text, HasSubstr("exports no symbol"));
}

TEST(PluginHost, OtherMachineIsRefused) {
    test::ScratchFolder scratch;
    std::string bytes = read_bytes(test::plugin_file("plain"));
    bytes[18] = 40;  // e_machine: ARM
    std::ofstream(scratch.path() / "teres_arm.so", std::ios::binary) << bytes;
    EXPECT_THAT(load_plugin(scratch.path() / "teres_arm.so").error().text, HasSubstr("ELF machine 40"));
}

// Truncated anywhere, or with any header byte forged, the file may be refused or accepted, but reading it
// must be safe (the sanitizer presets watch) and must never find another version than the file has.
TEST(PluginHost, DamagedElfFilesAreReadSafely) {
    test::ScratchFolder scratch;
    const std::string good = read_bytes(test::plugin_file("plain"));
    const auto file = scratch.path() / "teres_damaged.so";
    int refused = 0;
    const auto try_bytes = [&](const std::string& bytes) {
        std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
        refused += read_elf_entry(file) ? 0 : 1;
    };
    for (std::size_t size = 0; size < good.size(); size += 97) try_bytes(good.substr(0, size));
    EXPECT_EQ(refused, static_cast<int>((good.size() + 96) / 97)) << "section headers stand at the end";
    std::mt19937 random(7);
    refused = 0;
    for (int round = 0; round < 500; ++round) {
        std::string bytes = good;
        // Half of the changes in the ELF header and program headers, half in the section headers at the end.
        const std::size_t from = round % 2 == 0 ? 0 : bytes.size() - std::min<std::size_t>(bytes.size(), 2048);
        for (int change = 0; change < 3; ++change)
            bytes[from + random() % std::min<std::size_t>(bytes.size() - from, 2048)] = static_cast<char>(random());
        try_bytes(bytes);
    }
    EXPECT_GT(refused, 10);
}

TEST(PluginHost, FindsByIdOrPathAndListsWhatIsThere) {
    const std::vector<std::filesystem::path> folders = {"/no/such/folder", test::plugin_folder()};
    EXPECT_EQ(*find_plugin("plain", folders), test::plugin_file("plain"));
    EXPECT_EQ(*find_plugin(test::plugin_file("echo").string(), {}), test::plugin_file("echo"));
    EXPECT_THAT(find_plugin("pain", folders).error().text,
                AllOf(HasSubstr("no teres_pain.so in /no/such/folder, "), HasSubstr("plain")));
    EXPECT_THAT(find_plugin("../plain", folders).error().text, HasSubstr("no such plugin file"));
    EXPECT_THAT(available_plugins(folders), testing::IsSupersetOf({"echo", "life", "plain", "ramp"}));
}

TEST(PluginHost, SearchesBesideTheProgram) {
    const auto folders = plugin_folders("/given");
    ASSERT_GE(folders.size(), 2u);
    EXPECT_EQ(folders[0], "/given");
    const auto program = std::filesystem::read_symlink("/proc/self/exe");
    EXPECT_EQ(folders[1], program.parent_path().parent_path() / "lib/teres/plugins");
}

}  // namespace
}  // namespace teres
