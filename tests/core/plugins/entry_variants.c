/* A plugin in plain C whose entry is as good or as broken as the macros say (CMakeLists.txt). */
#include <signal.h>
#include <unistd.h>

#include "core/plugin.h"

#ifndef MAGIC
#define MAGIC TERES_PLUGIN_MAGIC
#endif
#ifndef STRUCT_SIZE
#define STRUCT_SIZE sizeof(teres_plugin_entry_t)
#endif
#ifndef API_MAJOR
#define API_MAJOR TERES_API_MAJOR
#endif
#ifndef API_MINOR
#define API_MINOR TERES_API_MINOR
#endif
#ifndef ENTRY_NAME
#define ENTRY_NAME teres_plugin_entry
#endif
#ifndef NUM_FACTORIES
#define NUM_FACTORIES 1
#endif
#ifndef STEP
#define STEP &step
#endif
#ifndef DEFAULT_NUMBER
#define DEFAULT_NUMBER 1.0
#endif
#ifndef SETTING_KEY
#define SETTING_KEY "gain"
#endif
#ifndef CREATED
#define CREATED &the_unit
#endif

void absent_function(void);

void pause_for_ever(void);
void pause_for_ever(void) {
    for (;;) pause();
}

#ifdef CONSTRUCTOR
__attribute__((constructor)) static void when_loaded(void) {
    CONSTRUCTOR;
}
#endif

static int the_unit;
static void* create(const teres_host* host) {
    (void)host;
    (void)the_unit;
    return CREATED;
}
static int32_t configure(void* self, const teres_setting_value* values, size_t count, char* error,
                         size_t size) {
    (void)self, (void)values, (void)count, (void)error, (void)size;
    return 0;
}
static int32_t start(void* self, char* error, size_t size) {
    (void)self, (void)error, (void)size;
    return 0;
}
__attribute__((unused)) static int32_t step(void* self, int64_t now_us) {
    (void)self, (void)now_us;
    return TERES_STEP_IDLE;
}
static void stop(void* self) {
    (void)self;
}

static const teres_setting settings[] = {
    {SETTING_KEY, "", NULL, NULL, DEFAULT_NUMBER, 0.0, 10.0, TERES_SETTING_NUMBER},
};
static const teres_factory factory = {sizeof(teres_factory),
                                      TERES_UNIT_PLUGIN,
                                      "plain",
                                      "does nothing",
                                      settings,
                                      1,
                                      &create,
                                      &configure,
                                      &start,
                                      STEP,
                                      &stop,
                                      &stop,
                                      NULL};
static const teres_factory* const factories[] = {&factory};

#ifdef RUN_TIME_ENTRY
__attribute__((visibility("default"))) teres_plugin_entry_t ENTRY_NAME;
__attribute__((constructor)) static void fill(void) {
    ENTRY_NAME.magic = MAGIC;
    ENTRY_NAME.struct_size = STRUCT_SIZE;
    ENTRY_NAME.api_major = API_MAJOR;
    ENTRY_NAME.num_factories = NUM_FACTORIES;
    ENTRY_NAME.factories = factories;
}
#else
__attribute__((visibility("default"))) extern const teres_plugin_entry_t ENTRY_NAME;
const teres_plugin_entry_t ENTRY_NAME = {MAGIC,         STRUCT_SIZE, API_MAJOR, API_MINOR,
                                         NUM_FACTORIES, "plain",     "1.2.3",   factories};
#endif
