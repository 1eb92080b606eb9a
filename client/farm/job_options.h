/* job_options: the options that describe a job, shared by submit and render. */
#ifndef AZULEJO_CLIENT_JOB_OPTIONS_H
#define AZULEJO_CLIENT_JOB_OPTIONS_H

#include "client/farm/connection.h"
#include "client/import/import.h"
#include "client/farm/needs_options.h"
#include "client/farm/output.h"
#include "client/farm/stop_options.h"
#include "client/terminal/frame_list.h"
#include "common/base/buffer.h"
#include "common/base/options.h"
#include "common/film/tiles.h"
#include "common/scene/scene.h"
#include "common/scene/settings.h"

struct job_options {
    struct import_options import;
    const char *camera, *size, *region, *env_sampling, *isa;
    const char *sampler, *light_choice, *roulette, *texture_filter, *bvh_quality, *robust;
    struct frame_choice frames;
    struct option_list without, aovs;
    struct output_options output;
    int alpha;
    double env_rotate_deg, env_strength;
    double fps, shutter, lens_radius, focus_distance;
    struct stop_options stop;
    const char *schedule_path;
    double clamp;
    int64_t max_depth, seed, priority;
    int half;
};

#define JOB_OPTIONS_INIT                                                                        \
    {.import = IMPORT_OPTIONS_DEFAULT, .env_strength = 1, .env_sampling = "importance", .isa = "avx2", \
     .sampler = "sobol", .light_choice = "tree", .roulette = "on", .texture_filter = "cone",    \
     .bvh_quality = "medium", .robust = "on",                                                   \
     .max_depth = -1,                                                                           \
     .fps = 24, .lens_radius = -1, .output = OUTPUT_OPTIONS_INIT}

/* A job's options, except those about when a frame has enough samples. */
#define JOB_SCENE_ROWS(o)                                                                      \
    IMPORT_OPTION_ROWS((o).import),                                                             \
    {"env-rotate", 0, OPTION_REAL, &(o).env_rotate_deg, "DEG",                                  \
     "turn the environment about +Y, counter-clockwise seen from above (default 0)",            \
     -36000, 36000, NULL},                                                                      \
    {"env-strength", 0, OPTION_REAL, &(o).env_strength, "X",                                    \
     "multiply the environment's radiance (default 1)", 0, 1e6, NULL},                          \
    {"env-sampling", 0, OPTION_CHOICE, &(o).env_sampling, "HOW",                                \
     "how light directions are chosen from the environment (default importance)", 0, 0,         \
     "importance|uniform|bsdf|importance-only|uniform-only"},                                   \
    {"camera", 0, OPTION_STRING, &(o).camera, "NAME",                                           \
     "camera by name, or by number from 0 (default: the first)", 0, 0, NULL},                   \
    {"frames", 'f', OPTION_STRING, &(o).frames.list, "LIST",                                    \
     "frames to render, as in 1-48 or 1,5,10-100x10 (default 1, or 0, the start, of a scene in " \
     "which something moves)", 0, 0, NULL},                                                     \
    {"fps", 0, OPTION_REAL, &(o).fps, "N",                                                      \
     "frames a second: frame F shows the scene at F/N seconds (default 24)", 0.001, 100000,     \
     NULL},                                                                                     \
    {"shutter", 0, OPTION_REAL, &(o).shutter, "FRACTION",                                       \
     "share of a frame's time that the shutter is open, 0 to 1: what moves is blurred "         \
     "(default 0: as long as the camera says)", 0, 1, NULL},                                    \
    {"lens", 0, OPTION_REAL, &(o).lens_radius, "METRES",                                        \
     "radius of the aperture, which blurs what is out of focus; 0 is a pinhole (default: the "     \
     "camera's own)", 0, 1e12, NULL},                                                              \
    {"focus", 0, OPTION_REAL, &(o).focus_distance, "METRES",                                    \
     "distance of what is sharp (default: the camera's own)", 1e-12, 1e12, NULL},               \
    {"without", 0, OPTION_LIST, &(o).without, "EFFECT,...",                                 \
     "leave these effects out, as in caustics,dispersion; a wrong name lists all", 0, 0, NULL}, \
    {"aov", 0, OPTION_LIST, &(o).aovs, "NAME,...",                                          \
     "add these output variables to the EXR, as in depth,normal; a wrong name lists all",       \
     0, 0, NULL},                                                                               \
    {"size", 's', OPTION_STRING, &(o).size, "WxH",                                              \
     "pixels (default: the file's own, 720 rows at the camera's aspect, or 1280x720)", 0, 0,     \
     NULL},                                                                                     \
    {"alpha", 0, OPTION_FLAG, &(o).alpha, NULL,                                                   \
     "a channel A: what camera rays meet; what is seen behind everything, as the environment, is "  \
     "left out of the picture", 0, 0, NULL},                                                        \
    {"region", 0, OPTION_STRING, &(o).region, "X,Y,W,H",                                        \
     "render only this rectangle of the picture, in pixels from its upper left corner: the same "   \
     "bits as in the whole picture (default: all)", 0, 0, NULL},                                    \
    {"max-depth", 0, OPTION_INT, &(o).max_depth, "N",                                           \
     "path edges after the camera's ray; 0 shows emitters only (default: the file's own, or 12)", \
     0, SETTINGS_DEPTH_MAX, NULL},                                                              \
    {"roulette", 0, OPTION_CHOICE, &(o).roulette, "HOW",                                        \
     "end paths that carry little light at random; off: only at --max-depth (default on)", 0, 0,   \
     "on|off"},                                                                                 \
    {"sampler", 0, OPTION_CHOICE, &(o).sampler, "NAME",                                         \
     "random numbers: scrambled Sobol' points, or independent ones (default sobol)", 0, 0,      \
     "sobol|independent"},                                                                      \
    {"light-choice", 0, OPTION_CHOICE, &(o).light_choice, "HOW",                                \
     "choose lights by their effect at the point, by their power, or uniformly (default tree)", \
     0, 0, "tree|power|uniform"},                                                               \
    {"clamp", 0, OPTION_REAL, &(o).clamp, "X",                                                  \
     "scale samples of more linear radiance (before exposure) down to X, against fireflies; "      \
     "removes light, and reports how much (default 0: off)", 0, (double)SETTINGS_CLAMP_MAX, NULL}, \
    {"texture-filter", 0, OPTION_CHOICE, &(o).texture_filter, "HOW",                            \
     "filter textures by the width of the ray's cone, or use only their finest level, "            \
     "interpolated or by its nearest texel (default cone)", 0, 0, "cone|bilinear|nearest"},        \
    {"bvh-quality", 0, OPTION_CHOICE, &(o).bvh_quality, "HOW",                                  \
     "quality of Embree's trees; high needs --robust off (default medium)", 0, 0, \
     "low|medium|high"},                                                                        \
    {"robust", 0, OPTION_CHOICE, &(o).robust, "HOW",                                            \
     "stop rays from slipping between triangles; off is faster but may leak (default on)", 0, 0, \
     "on|off"},                                                                                 \
    {"seed", 0, OPTION_INT, &(o).seed, "N",                                                     \
     "another seed gives different noise, the same seed the same bits (default 0)",                \
     0, 9e18, NULL},                                                                            \
    OUTPUT_OPTION_ROWS((o).output),                                                             \
    {"half", 0, OPTION_FLAG, &(o).half, NULL,                                                   \
     "16-bit floats in the EXR instead of 32-bit ones", 0, 0, NULL},                            \
    {"isa", 0, OPTION_CHOICE, &(o).isa, "NAME",                                                 \
     "instruction set for the ray tracing of every worker (default avx2)", 0, 0,          \
     "sse2|avx2|avx512"},                                                                       \
    {"priority", 0, OPTION_INT, &(o).priority, "N",                                             \
     "jobs with a higher number go first (default 0)", -1000000, 1000000, NULL}

/* For commands that take a list of frames with gaps. */
#define JOB_ENDS_ROW(o)                                                                         \
    {"first-middle-last", 0, OPTION_FLAG, &(o).frames.first_middle_last, NULL,                  \
     "only the first, the middle and the last of the --frames", 0, 0, NULL}

#define JOB_OPTION_ROWS(o)                                                                      \
    JOB_SCENE_ROWS(o),                                                                          \
    STOP_OPTION_ROWS((o).stop, "the file's own, or 256; with another rule: no limit"),          \
    ALLOCATION_OPTION_ROW((o).stop),                                                            \
    {"min-spp", 0, OPTION_INT, &(o).stop.spp_min, "N",                                          \
     "samples a pixel before --target-error may end a frame, at least (default 16)",               \
     1, SETTINGS_SPP_MAX,                                                                          \
     NULL},                                                                                     \
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
    int spp_given;               /* a file's own number of samples does not count */
    struct buffer schedule;      /* passes [tile][group]; empty: none */
    uint32_t schedule_width, schedule_height;
    char schedule_region[SETTINGS_REGION_TEXT_SIZE]; /* settings_region_text of its picture */
    struct output_request output;
    struct buffer source;        /* words for a shell: the scene's file, and the options of its import */
    struct tile_rect region;     /* of the whole picture to render; width 0: all */
    uint32_t first_frame, last_frame;
    struct frame_list frames;    /* the only ones to render until the job continues; count 0: all */
    int estimate;                /* to predict the job's cost; the job continues it when submitted
                                    */
    int32_t priority;
    int force;                   /* also if it does not fit the coordinator's disk */
    struct needs_request needs;
    const char *owner;           /* whose job it is, user@host; NULL or "": of who runs this program */
    /* The submission's own name, so that it can be sent twice and is one job; "": none. */
    char token[JOB_TOKEN_BYTES_MAX + 1];
};

/* Once the size is known: the picture is the region. ERR_USAGE: it is not inside. */
status job_request_crop(struct job_request *request, struct error *err) MUST_CHECK;

/* Check what can be checked before the scene is read, so that a wrong option is reported at once.
 * The operator's file is read. ERR_USAGE or ERR_INPUT; release after a failure, too. */
status job_options_check(const struct job_options *o, struct job_request *out, struct error *err)
    MUST_CHECK;
void job_request_release(struct job_request *request);
/* For commands that need every frame from the first to the last. ERR_USAGE. */
status job_request_one_range(const struct job_request *request, struct error *err) MUST_CHECK;

/* Fill in what depends on the scene: the camera, the default size and frame, and the camera's
 * exposure, which is added to the job's. ERR_USAGE for options that do not fit the scene. */
status job_request_complete(struct job_request *request, const struct job_options *o,
                            const struct scene *scene, struct error *err) MUST_CHECK;

/* Submit; the scene's blobs, the packed scene and the operator's file must be
 * stored already. */
struct job_accepted {
    uint64_t job;
    uint32_t estimate_spp;       /* not 0: it was an estimate, and continues from this many samples
                                    a pixel */
};
status job_request_submit(struct connection *c, const struct job_request *request,
                          const char *name, const struct digest *scene, unsigned formats,
                          struct job_accepted *out, struct error *err) MUST_CHECK;

#endif
