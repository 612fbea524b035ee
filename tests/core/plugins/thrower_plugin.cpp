// Written against the C interface by an author who lets exceptions out: from step, after `after` good steps.
#include <stdexcept>

#include "core/plugin.h"

namespace {

int g_left = 0;

void* create(const teres_host*) {
    return &g_left;
}
int32_t configure(void*, const teres_setting_value* values, size_t, char*, size_t) {
    g_left = static_cast<int>(values[0].number);
    return 0;
}
int32_t start(void*, char*, size_t) {
    return 0;
}
int32_t step(void*, int64_t) {
    if (g_left-- == 0) throw std::runtime_error("out of step");
    return TERES_STEP_IDLE;
}
void nothing(void*) {}

const teres_setting kSettings[] = {{"after", "", nullptr, nullptr, 3.0, 0.0, 100.0, TERES_SETTING_INTEGER}};
const teres_factory kFactory = {sizeof(teres_factory),
                                TERES_UNIT_PLUGIN,
                                "thrower",
                                "throws",
                                kSettings,
                                1,
                                &create,
                                &configure,
                                &start,
                                &step,
                                &nothing,
                                &nothing,
                                nullptr};
const teres_factory* const kFactories[] = {&kFactory};

}  // namespace

extern "C" __attribute__((visibility("default"))) const teres_plugin_entry_t teres_plugin_entry;
const teres_plugin_entry_t teres_plugin_entry = {
    TERES_PLUGIN_MAGIC, sizeof(teres_plugin_entry_t), TERES_API_MAJOR, TERES_API_MINOR, 1, "thrower", "1", kFactories};
