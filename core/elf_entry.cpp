#include "core/elf_entry.h"

#include <elf.h>
#include <fcntl.h>
#include <unistd.h>

#include <cstddef>
#include <cstring>
#include <string>
#include <vector>

#include "core/plugin.h"

namespace teres {
namespace {

#if defined(__x86_64__)
constexpr Elf64_Half kMachine = EM_X86_64;
#elif defined(__aarch64__)
constexpr Elf64_Half kMachine = EM_AARCH64;
#else
#error "add the ELF machine of this processor"
#endif

constexpr const char* kSymbol = "teres_plugin_entry";
// Far above any plugin of ours; keeps a forged header from making us allocate.
constexpr std::size_t kMaxHeaders = 4096;
constexpr std::size_t kMaxTableBytes = std::size_t{64} << 20;

// Reads from the file, never past its end, never mapped: a file cut short under our hands is an error, not a
// SIGBUS.
class FileReader {
  public:
    explicit FileReader(const std::filesystem::path& file) : fd_(open(file.c_str(), O_RDONLY | O_CLOEXEC)) {}
    ~FileReader() {
        if (fd_ >= 0) close(fd_);
    }
    FileReader(const FileReader&) = delete;
    FileReader& operator=(const FileReader&) = delete;
    bool is_open() const { return fd_ >= 0; }

    bool read(std::uint64_t offset, void* to, std::size_t size) const {
        if (offset > static_cast<std::uint64_t>(INT64_MAX) - size) return false;
        auto* bytes = static_cast<char*>(to);
        while (size > 0) {
            const ssize_t got = pread(fd_, bytes, size, static_cast<off_t>(offset));
            if (got <= 0) return false;
            bytes += got;
            offset += static_cast<std::uint64_t>(got);
            size -= static_cast<std::size_t>(got);
        }
        return true;
    }
    template <class T>
    bool read_table(std::uint64_t offset, std::size_t count, std::vector<T>& to) const {
        if (count > kMaxTableBytes / sizeof(T)) return false;
        to.resize(count);
        return read(offset, to.data(), count * sizeof(T));
    }

  private:
    int fd_;
};

}  // namespace

Result<ElfEntry> read_elf_entry(const std::filesystem::path& file) {
    const std::string name = file.string();
    const FileReader reader(file);
    if (!reader.is_open()) return invalid_input(name + ": cannot be opened (" + std::strerror(errno) + ")");

    Elf64_Ehdr header{};
    if (!reader.read(0, &header, sizeof(header)) || std::memcmp(header.e_ident, ELFMAG, SELFMAG) != 0)
        return invalid_input(name + ": not an ELF shared object");
    if (header.e_ident[EI_CLASS] != ELFCLASS64 || header.e_ident[EI_DATA] != ELFDATA2LSB ||
        header.e_machine != kMachine)
        return invalid_input(name + ": built for another machine (ELF machine " + std::to_string(header.e_machine) +
                             ", class " + std::to_string(header.e_ident[EI_CLASS]) + "), needed are machine " +
                             std::to_string(kMachine) + ", class 2");
    if (header.e_type != ET_DYN)
        return invalid_input(name + ": ELF type " + std::to_string(header.e_type) + " is not a shared object (3)");

    const auto damaged = [&](const char* what) { return invalid_input(name + ": damaged ELF file (" + what + ")"); };
    std::vector<Elf64_Phdr> segments;
    std::vector<Elf64_Shdr> sections;
    if (header.e_phnum > kMaxHeaders || header.e_phentsize != sizeof(Elf64_Phdr) ||
        !reader.read_table(header.e_phoff, header.e_phnum, segments))
        return damaged("program headers");
    if (header.e_shnum > kMaxHeaders || (header.e_shnum > 0 && header.e_shentsize != sizeof(Elf64_Shdr)) ||
        !reader.read_table(header.e_shoff, header.e_shnum, sections))
        return damaged("section headers");

    Elf64_Sym entry{};
    bool found = false;
    for (const Elf64_Shdr& section : sections) {
        if (section.sh_type != SHT_DYNSYM || found) continue;
        std::vector<Elf64_Sym> symbols;
        std::vector<char> names;
        if (section.sh_link >= sections.size() ||
            !reader.read_table(section.sh_offset, section.sh_size / sizeof(Elf64_Sym), symbols) ||
            !reader.read_table(sections[section.sh_link].sh_offset, sections[section.sh_link].sh_size, names) ||
            names.empty() || names.back() != '\0')
            return damaged("dynamic symbols");
        for (const Elf64_Sym& symbol : symbols) {
            if (symbol.st_shndx == SHN_UNDEF || symbol.st_name >= names.size()) continue;
            if (std::strcmp(names.data() + symbol.st_name, kSymbol) != 0) continue;
            entry = symbol;
            found = true;
            break;
        }
    }
    if (!found)
        return invalid_input(name + ": exports no symbol " + kSymbol +
                             "; a plugin ends with TERES_PLUGIN(...), see core/plugin.h");

    ElfEntry told;
    constexpr std::size_t kTold = offsetof(teres_plugin_entry_t, num_factories);
    if (entry.st_size < kTold)
        return invalid_input(name + ": " + kSymbol + " is " + std::to_string(entry.st_size) + " bytes, " +
                             std::to_string(sizeof(teres_plugin_entry_t)) + " are needed");
    for (const Elf64_Phdr& segment : segments) {
        if (segment.p_type != PT_LOAD || segment.p_filesz < kTold || entry.st_value < segment.p_vaddr ||
            entry.st_value - segment.p_vaddr > segment.p_filesz - kTold)
            continue;
        unsigned char bytes[kTold];
        if (!reader.read(segment.p_offset + (entry.st_value - segment.p_vaddr), bytes, kTold)) return damaged("entry");
        std::memcpy(&told.magic, bytes + offsetof(teres_plugin_entry_t, magic), sizeof(told.magic));
        std::memcpy(&told.struct_size, bytes + offsetof(teres_plugin_entry_t, struct_size), sizeof(told.struct_size));
        std::memcpy(&told.api_major, bytes + offsetof(teres_plugin_entry_t, api_major), sizeof(told.api_major));
        std::memcpy(&told.api_minor, bytes + offsetof(teres_plugin_entry_t, api_minor), sizeof(told.api_minor));
        return told;
    }
    return invalid_input(name + ": " + kSymbol +
                         " is not constant data; its version cannot be checked before its code runs");
}

}  // namespace teres
