/* What a plugin is: the first file an author reads. C only: no exception, RTTI or standard library object crosses.
 *
 * A plugin is one shared object that exports one data symbol, `teres_plugin_entry`. The host reads magic, sizes and
 * version before any code of the plugin runs (and first in a child process, so that a broken plugin cannot take the
 * service down), then makes units (plugins or drivers) from the entry's factories by id.
 *
 *     create -> configure -> start -> step ... step -> stop -> destroy        (stop -> configure restarts)
 *
 * Calls are tagged. [setup]: may block, allocate, read files. [loop]: must return within the frame; no file I/O, no
 * waiting, no throw, no unbounded allocation. All calls of one unit come from one thread.
 * C++ authors derive from teres::Unit in core/plugin_sdk.h and end plugin.cpp with TERES_PLUGIN(...).
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define TERES_PLUGIN_MAGIC 0x53455254u /* "TRES" */
#define TERES_API_MAJOR 1              /* must be equal */
#define TERES_API_MINOR 0              /* the plugin's must not be above the host's */

typedef enum teres_log_level {
    TERES_LOG_DEBUG = 0,
    TERES_LOG_INFO = 1,
    TERES_LOG_WARN = 2,
    TERES_LOG_ERROR = 3
} teres_log_level;

/* What step returns. */
typedef enum teres_step_outcome {
    TERES_STEP_IDLE = 0,     /* nothing to do */
    TERES_STEP_DONE = 1,     /* work done */
    TERES_STEP_DEGRADED = 2, /* work done, result stale or not converged: counted in HEALTH */
    TERES_STEP_FINISHED = 3  /* a driver's stream has ended */
} teres_step_outcome;

typedef enum teres_unit_kind { TERES_UNIT_PLUGIN = 0, TERES_UNIT_DRIVER = 1 } teres_unit_kind;

typedef enum teres_setting_type {
    TERES_SETTING_NUMBER = 0,
    TERES_SETTING_INTEGER = 1,
    TERES_SETTING_BOOLEAN = 2,
    TERES_SETTING_TEXT = 3,
    TERES_SETTING_PATH = 4 /* handed out absolute (or empty): a relative one is taken from the settings file's folder */
} teres_setting_type;

/* One setting: the only place where its default, unit (suffix of key), range and help are written. */
typedef struct teres_setting {
    const char* key;
    const char* help;
    const char* default_text; /* TEXT, PATH */
    const char* choices;      /* TEXT only: "a|b|c", NULL or "" if free */
    double default_number;    /* NUMBER, INTEGER, BOOLEAN (0 or 1) */
    double min, max;          /* NUMBER, INTEGER: closed range */
    int32_t type;             /* teres_setting_type */
} teres_setting;

/* A resolved setting; the host has already checked key, type, range and choice. */
typedef struct teres_setting_value {
    const char* key;
    const char* text;
    double number;
    int32_t type;
} teres_setting_value;

/* Called by the host with the bytes of one message. [loop] `data` is valid during the call only. */
typedef void (*teres_message_handler)(void* user, const char* channel, const void* data, size_t size,
                                      int64_t receive_us);

/* What the host offers; valid from create to destroy. */
typedef struct teres_host {
    uint32_t struct_size;
    void* context;
    /* [setup][loop] any thread */
    void (*log)(void* context, int32_t level, const char* source, const char* text);
    /* [loop] 0, or -1 if the message was refused (counted) */
    int32_t (*publish)(void* context, const char* channel, const void* data, size_t size);
    /* [setup] messages above max_bytes are refused and counted */
    int32_t (*subscribe)(void* context, const char* channel, size_t max_bytes, teres_message_handler handler,
                         void* user);
    /* [setup] an interface that another unit of this process offers (core/extensions), or NULL. Units start in the
       order of the settings file: ask in start, for interfaces of units named before. */
    void* (*extension)(void* context, const char* extension_id);
    /* [loop] monotonic clock; during a replay the clock of the recording */
    int64_t (*now_us)(void* context);
} teres_host;

typedef struct teres_factory {
    uint32_t struct_size;
    int32_t kind;        /* teres_unit_kind */
    const char* id;      /* name of the section in the settings file */
    const char* summary; /* one line */
    const teres_setting* settings;
    size_t num_settings;
    void* (*create)(const teres_host* host); /* [setup] NULL on failure */
    /* [setup] 0 or a teres::ErrorKind; then `error` holds a text */
    int32_t (*configure)(void* self, const teres_setting_value* values, size_t num_values, char* error,
                         size_t error_size);
    int32_t (*start)(void* self, char* error, size_t error_size);
    int32_t (*step)(void* self, int64_t now_us);              /* [loop] teres_step_outcome */
    void (*stop)(void* self);                                 /* [setup] */
    void (*destroy)(void* self);                              /* [setup] */
    void* (*extension)(void* self, const char* extension_id); /* [setup] NULL if not offered */
} teres_factory;

typedef struct teres_plugin_entry_t {
    uint32_t magic;
    uint32_t struct_size;
    uint16_t api_major;
    uint16_t api_minor;
    uint32_t num_factories;
    const char* name;
    const char* version;
    const teres_factory* const* factories;
} teres_plugin_entry_t;

#ifdef __cplusplus
}
#endif
