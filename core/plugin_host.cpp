#include "core/plugin_host.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <set>

namespace teres {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t kMaxFactories = 64;
constexpr std::size_t kMaxSettings = 1000;
constexpr std::string_view kPrefix = "teres_", kSuffix = ".so";

std::string api_text(unsigned major, unsigned minor) {
    return std::to_string(major) + "." + std::to_string(minor);
}

std::string hex(std::uint32_t value) {
    char text[16];
    std::snprintf(text, sizeof(text), "0x%08x", value);
    return text;
}

// A factory's table as the config checks it: broken tables are refused here, once.
Status check_factory(const std::string& name, const teres_factory* factory) {
    if (factory == nullptr) return invalid_input(name + ": a factory is null");
    if (factory->struct_size < sizeof(teres_factory))
        return invalid_input(name + ": a factory is " + std::to_string(factory->struct_size) + " bytes, " +
                             std::to_string(sizeof(teres_factory)) + " are needed");
    if (factory->id == nullptr || *factory->id == '\0') return invalid_input(name + ": a factory has no id");
    const std::string unit = name + ": unit " + factory->id;
    if (std::string_view(factory->id) == "service")
        return invalid_input(unit + ": the id `service` is taken by the runtime");
    if (factory->kind != TERES_UNIT_PLUGIN && factory->kind != TERES_UNIT_DRIVER)
        return invalid_input(unit + ": kind " + std::to_string(factory->kind) +
                             " is neither plugin (0) nor driver (1)");
    if (factory->create == nullptr || factory->configure == nullptr || factory->start == nullptr ||
        factory->step == nullptr || factory->stop == nullptr || factory->destroy == nullptr)
        return invalid_input(unit + ": create, configure, start, step, stop and destroy are all needed");
    if (factory->num_settings > kMaxSettings || (factory->num_settings > 0 && factory->settings == nullptr))
        return invalid_input(unit + ": a table of " + std::to_string(factory->num_settings) +
                             " settings is above the bound " + std::to_string(kMaxSettings) + " or missing");
    std::set<std::string_view> keys;
    for (const teres_setting& setting : std::span(factory->settings, factory->num_settings)) {
        if (setting.key == nullptr || *setting.key == '\0') return invalid_input(unit + ": a setting has no key");
        const std::string where = unit + ": setting " + setting.key;
        if (!keys.insert(setting.key).second) return invalid_input(where + " is listed twice");
        if (setting.type < TERES_SETTING_NUMBER || setting.type > TERES_SETTING_PATH)
            return invalid_input(where + " has the unknown type " + std::to_string(setting.type));
        const bool ranged = setting.type == TERES_SETTING_NUMBER || setting.type == TERES_SETTING_INTEGER;
        if (ranged && !(setting.min <= setting.default_number && setting.default_number <= setting.max))
            return invalid_input(where + " has a default outside of its range");
    }
    return {};
}

Result<PluginFile> open_checked(const fs::path& file) {
    const std::string name = file.string();
    dlerror();
    void* handle = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    if (handle == nullptr) {
        const char* reason = dlerror();
        return host_fault(name + ": cannot be loaded (" + (reason != nullptr ? reason : "no reason given") +
                          "); install the missing library or rebuild the plugin on this host");
    }
    const auto* entry = static_cast<const teres_plugin_entry_t*>(dlsym(handle, "teres_plugin_entry"));
    if (entry == nullptr) return invalid_input(name + ": exports no symbol teres_plugin_entry");
    // Once more on the live entry: static constructors have run since the file was read.
    TERES_TRY(check_version(name, {entry->magic, entry->struct_size, entry->api_major, entry->api_minor}));
    if (entry->num_factories == 0 || entry->num_factories > kMaxFactories || entry->factories == nullptr)
        return invalid_input(name + ": " + std::to_string(entry->num_factories) + " factories, needed are 1 to " +
                             std::to_string(kMaxFactories));
    PluginFile plugin;
    plugin.file = file;
    plugin.name = entry->name != nullptr ? entry->name : file.stem().string();
    plugin.version = entry->version != nullptr ? entry->version : "";
    plugin.api_major = entry->api_major;
    plugin.api_minor = entry->api_minor;
    for (const teres_factory* factory : std::span(entry->factories, entry->num_factories)) {
        TERES_TRY(check_factory(name, factory));
        plugin.factories.push_back(factory);
    }
    return plugin;
}

// Answer of the child: the kind of the error (0: none), then its text. EOF without it: the child died.
[[noreturn]] void answer_as_child(const fs::path& file, int answer) {
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    const rlimit no_core{0, 0};
    setrlimit(RLIMIT_CORE, &no_core);
    for (const int number : {SIGTERM, SIGINT, SIGHUP, SIGABRT, SIGSEGV}) signal(number, SIG_DFL);
    const Result<PluginFile> loaded = open_checked(file);
    std::string text(1, static_cast<char>(loaded ? 0 : static_cast<int>(loaded.error().kind)));
    if (!loaded) text += loaded.error().text.substr(0, 4000);  // below PIPE_BUF: one write
    const ssize_t written = write(answer, text.data(), text.size());
    _exit(written == static_cast<ssize_t>(text.size()) ? 0 : 1);
}

std::string how_it_ended(int status) {
    if (WIFSIGNALED(status))
        return std::string("crashed with signal ") + std::to_string(WTERMSIG(status)) + " (" +
               strsignal(WTERMSIG(status)) + ")";
    return "ended its process with exit code " + std::to_string(WEXITSTATUS(status));
}

}  // namespace

const teres_factory* PluginFile::factory(std::string_view id) const {
    for (const teres_factory* candidate : factories)
        if (candidate->id == id) return candidate;
    return nullptr;
}

std::vector<fs::path> plugin_folders(const fs::path& given) {
    std::vector<fs::path> folders;
    if (!given.empty()) folders.push_back(given);
    std::error_code failure;
    const fs::path program = fs::read_symlink("/proc/self/exe", failure);
    if (!failure) {
        const fs::path prefix = program.parent_path().parent_path();
        for (const char* library_folder : {"lib", TERES_INSTALL_LIBDIR}) {
            const fs::path folder = prefix / library_folder / "teres" / "plugins";
            if (std::find(folders.begin(), folders.end(), folder) == folders.end()) folders.push_back(folder);
        }
    }
    return folders;
}

Result<fs::path> find_plugin(const std::string& id, std::span<const fs::path> folders) {
    std::error_code failure;
    if (id.find('/') != std::string::npos) {
        if (fs::is_regular_file(id, failure)) return fs::path(id);
        return invalid_input(id + ": no such plugin file");
    }
    std::string searched;
    for (const fs::path& folder : folders) {
        const fs::path file = folder / (std::string(kPrefix) + id + std::string(kSuffix));
        if (fs::is_regular_file(file, failure)) return file;
        searched += (searched.empty() ? "" : ", ") + folder.string();
    }
    std::string there;
    for (const std::string& name : available_plugins(folders)) there += (there.empty() ? "" : ", ") + name;
    return invalid_input("unit " + id + ": no " + std::string(kPrefix) + id + std::string(kSuffix) + " in " + searched +
                         "; there are: " + (there.empty() ? "none" : there));
}

std::vector<std::string> available_plugins(std::span<const fs::path> folders) {
    std::set<std::string> names;
    for (const fs::path& folder : folders) {
        std::error_code failure;
        for (fs::directory_iterator at(folder, failure), end; !failure && at != end; at.increment(failure)) {
            const std::string name = at->path().filename().string();
            if (name.size() > kPrefix.size() + kSuffix.size() && name.starts_with(kPrefix) && name.ends_with(kSuffix))
                names.insert(name.substr(kPrefix.size(), name.size() - kPrefix.size() - kSuffix.size()));
        }
    }
    return {names.begin(), names.end()};
}

Status check_version(const std::string& name, const ElfEntry& entry) {
    if (entry.magic != TERES_PLUGIN_MAGIC)
        return invalid_input(name + ": magic " + hex(entry.magic) + " where " + hex(TERES_PLUGIN_MAGIC) +
                             " is needed: not a Teres plugin");
    if (entry.api_major != TERES_API_MAJOR || entry.api_minor > TERES_API_MINOR)
        return invalid_input(name + ": built for plugin API " + api_text(entry.api_major, entry.api_minor) +
                             ", this host offers " + api_text(TERES_API_MAJOR, TERES_API_MINOR) +
                             (entry.api_major == TERES_API_MAJOR ? "; install a newer Teres"
                                                                 : "; rebuild it against the headers of this Teres"));
    if (entry.struct_size < sizeof(teres_plugin_entry_t))
        return invalid_input(name + ": entry of " + std::to_string(entry.struct_size) + " bytes, " +
                             std::to_string(sizeof(teres_plugin_entry_t)) + " are needed");
    return {};
}

Status probe_plugin(const fs::path& file, std::chrono::milliseconds limit) {
    const std::string name = file.string();
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) return host_fault(name + ": cannot be probed: " + std::strerror(errno));
    const auto deadline = std::chrono::steady_clock::now() + limit;
    const pid_t child = fork();
    if (child < 0) {
        close(ends[0]);
        close(ends[1]);
        return host_fault(name + ": cannot be probed: " + std::strerror(errno));
    }
    if (child == 0) {
        close(ends[0]);
        answer_as_child(file, ends[1]);
    }
    close(ends[1]);
    char answer[4096];
    ssize_t size = 0;
    bool in_time = false;
    for (;;) {
        const auto left =
            std::chrono::duration_cast<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
        pollfd readable{ends[0], POLLIN, 0};
        const int ready = poll(&readable, 1, static_cast<int>(std::max<std::int64_t>(left.count(), 0)));
        if (ready < 0 && errno == EINTR) continue;
        in_time = ready > 0;
        if (in_time) size = read(ends[0], answer, sizeof(answer));
        break;
    }
    close(ends[0]);
    int status = 0;
    if (size <= 0 && in_time) {
        // The pipe broke: the child is dead or dying; its status says how.
        waitpid(child, &status, 0);
        kill(-child, SIGKILL);
        return invalid_input(name + ": " + how_it_ended(status) + " while being loaded in a child process");
    }
    kill(-child, SIGKILL);
    kill(child, SIGKILL);
    waitpid(child, &status, 0);
    if (!in_time)
        return invalid_input(name + ": hung for more than " + std::to_string(limit.count()) +
                             " ms while being loaded in a child process");
    if (answer[0] == 0) return {};
    return tl::unexpected(
        Error{static_cast<ErrorKind>(answer[0]), std::string(answer + 1, static_cast<std::size_t>(size) - 1)});
}

Result<PluginFile> load_plugin(const fs::path& file, std::chrono::milliseconds limit) {
    std::error_code failure;
    const fs::path absolute = fs::absolute(file, failure);
    TERES_TRY_ASSIGN(const ElfEntry entry, read_elf_entry(absolute));
    TERES_TRY(check_version(absolute.string(), entry));
    const bool loaded_before = dlopen(absolute.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NOLOAD) != nullptr;
    if (!loaded_before) TERES_TRY(probe_plugin(absolute, limit));
    return open_checked(absolute);
}

}  // namespace teres
