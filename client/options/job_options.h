/* job_options: the options that describe a job, shared by submit and render. */
#pragma once

#include "client/link/connection.h"
#include "client/import/import.h"
#include "client/options/needs_options.h"
#include "client/options/output.h"
#include "client/options/setting_option.h"
#include "client/options/stop_options.h"
#include "client/terminal/frame_list.h"
#include "common/base/buffer.h"
#include "common/cli/options.h"
#include "common/film/tiles.h"
#include "common/scene/scene.h"
#include "common/scene/settings.h"

struct job_options {
    struct import_options import;
    union setting_said said[SETTING_COUNT];
    const char *camera, *size, *fit, *region;
    struct frame_choice frames;
    struct output_options output;
    int alpha;
    struct stop_options stop;
    const char *schedule_path;
    int64_t priority;
    int half;
};

#define JOB_OPTIONS_INIT {.import = IMPORT_OPTIONS_OF_COMMANDS}

#define SETTING_OPTION(o, KIND, type, name, ...)                                                                       \
    setting_option(&render_settings_rows[SETTING_##name], &(o).said[SETTING_##name]),
#define SETTING_NO_OPTION(...)

/* A job's options, except those about when a frame has enough samples. */
#define JOB_SCENE_ROWS(o)                                                                      \
    IMPORT_OPTION_ROWS((o).import),                                                             \
    RENDER_SETTINGS(SETTING_NO_OPTION, SETTING_OPTION, o)                                       \
    {"camera", 0, OPTION_STRING, &(o).camera, "NAME",                                           \
     "camera by name, or by number from 0 (default: the first)", 0, 0, NULL},                   \
    {"frames", 'f', OPTION_STRING, &(o).frames.list, "LIST",                                    \
     "frames to render, as in 1-48 or 1,5,10-100x10 (default 1, or 0, the start, of a scene in " \
     "which something moves)", 0, 0, NULL},                                                     \
    {"size", 's', OPTION_STRING, &(o).size, "WxH",                                              \
     "pixels (default: the file's own, 720 rows at the camera's aspect, or 1280x720)", 0, 0,     \
     NULL},                                                                                     \
    {"fit", 0, OPTION_STRING, &(o).fit, "WxH",                                                  \
     "shrink the picture, or its --region, in its own proportions until it fits into so many "      \
     "pixels", 0, 0, NULL},                                                                         \
    {"alpha", 0, OPTION_FLAG, &(o).alpha, NULL,                                                   \
     "a channel A: what camera rays meet; what is seen behind everything, as the environment, is "  \
     "left out of the picture", 0, 0, NULL},                                                        \
    {"region", 0, OPTION_STRING, &(o).region, "X,Y,W,H",                                        \
     "render only this rectangle of the picture, in pixels from its upper left corner: the same "   \
     "bits as in the whole picture (default: all)", 0, 0, NULL},                                    \
    OUTPUT_OPTION_ROWS((o).output),                                                             \
    {"half", 0, OPTION_FLAG, &(o).half, NULL,                                                   \
     "16-bit floats in the EXR instead of 32-bit ones", 0, 0, NULL},                            \
    {"priority", 0, OPTION_INT, &(o).priority, "N",                                             \
     "jobs with a higher number go first (default 0)", -1000000, 1000000, NULL}

/* For commands that take a list of frames with gaps. */
#define JOB_ENDS_ROW(o)                                                                         \
    {"first-middle-last", 0, OPTION_FLAG, &(o).frames.first_middle_last, NULL,                  \
     "only the first, the middle and the last of the --frames", 0, 0, NULL}

#define JOB_OPTION_ROWS(o)                                                                      \
    JOB_SCENE_ROWS(o),                                                                          \
    STOP_SPP_ROW((o).stop, "the file's own, or 256; with another rule: no limit"),              \
    STOP_OPTION_ROWS((o).stop)                                                                  \
    {"schedule-from", 0, OPTION_STRING, &(o).schedule_path, "FILE.exr",                         \
     "give each tile the samples that it has in this picture, which was ended by a limit or a "    \
     "cancel",                                                                                     \
     0, 0, NULL}

/* For studies, which have their own rules for ending frames. */
#define JOB_STUDY_ROWS(o)                                                                       \
    JOB_SCENE_ROWS(o),                                                                          \
    {"spp", 'n', OPTION_INT, &(o).stop.spp, "N", "samples a pixel, at most", 1, SETTINGS_SPP_MAX, NULL}

enum { JOB_TOKEN_BYTES_MAX = 64 }; /* the coordinator's limit */

/* The options applied to a scene. Zero-initialise. */
struct job_request {
    struct render_settings settings;
    struct stop_rules stop;
    int spp_given;          /* a file's own number of samples does not count */
    struct buffer schedule; /* passes [tile][group]; empty: none */
    uint32_t schedule_width, schedule_height;
    char schedule_region[SETTINGS_REGION_TEXT_SIZE]; /* settings_region_text of its picture */
    struct output_request output;
    struct buffer source;           /* words for a shell: the scene's file, and the options of its import */
    struct tile_rect region;        /* of the whole picture to render; width 0: all */
    uint32_t fit_width, fit_height; /* it is shrunk until it fits into these; 0: it is not */
    uint32_t first_frame, last_frame;
    struct frame_list frames; /* the only ones to render until the job continues; count 0: all */
    int estimate;             /* to predict the job's cost; the job continues it when submitted
                                    */
    int32_t priority;
    int force; /* also if it does not fit the coordinator's disk */
    struct job_needs needs;
    const char *owner; /* whose job it is, user@host; NULL or "": of who runs this program */
    /* The submission's own name, so that it can be sent twice and is one job; "": none. */
    char token[JOB_TOKEN_BYTES_MAX + 1];
};

/* Once the size is known: shrink the picture as --fit says, and make it the region. ERR_USAGE: it is not inside. */
status job_request_crop(struct job_request *request, struct error *err) MUST_CHECK;

/* Check what can be checked before the scene is read, so that a wrong option is reported at once.
 * The operator's file is read. ERR_USAGE or ERR_INPUT; release after a failure, too. */
status job_options_check(const struct job_options *o, struct job_request *out, struct error *err) MUST_CHECK;
void job_request_release(struct job_request *request);
/* For commands that need every frame from the first to the last. ERR_USAGE. */
status job_request_one_range(const struct job_request *request, struct error *err) MUST_CHECK;

/* Fill in what depends on the scene: the camera, the default size and frame, and the camera's
 * exposure, which is added to the job's. ERR_USAGE for options that do not fit the scene. */
status job_request_complete(struct job_request *request, const struct job_options *o, const struct scene *scene,
                            struct error *err) MUST_CHECK;

/* Submit; the scene's blobs, the packed scene and the operator's file must be stored already. */
struct job_accepted {
    uint64_t job;
    uint32_t estimate_spp; /* not 0: it was an estimate, and continues from this many samples
                                    a pixel */
};
status job_request_submit(struct connection *c, const struct job_request *request, const char *name,
                          const struct digest *scene, unsigned formats, struct job_accepted *out,
                          struct error *err) MUST_CHECK;
