#include "core/case/text_writer.h"

#include <fstream>
#include <system_error>

namespace teres {

Status write_text_file(const std::filesystem::path& file, std::string_view text) {
    std::filesystem::path part = file;
    part += ".part";
    std::error_code code;
    {
        std::ofstream stream(part, std::ios::binary | std::ios::trunc);
        stream.write(text.data(), static_cast<std::streamsize>(text.size()));
        stream.flush();
        if (!stream) {
            std::filesystem::remove(part, code);
            return host_fault(file.string() + ": cannot be written (folder missing, no permission or disk full)");
        }
    }
    std::filesystem::rename(part, file, code);
    if (code) return host_fault(file.string() + ": cannot be written: " + code.message());
    return {};
}

}  // namespace teres
