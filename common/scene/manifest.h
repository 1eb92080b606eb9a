/* manifest: what was simulated in one frame, why, and where the time went.
 *
 * The coordinator keeps one with each finished frame, as JSON (docs/EFFECTS.md):
 *
 *   ran              effects that were simulated, what needs each, and its share of the time
 *   switched_off     effects that the scene needs, but the user does not want (--without)
 *   not_called_for   the rest: nothing in the frame needs them, so no code for them ran
 *   kernel           the variant of the renderer that ran (kernel_sets.h), and the renderer
 *   picture          its samples: all that were requested, unless its job was cancelled; the light that
 *                    --max-depth took (common/film/depth_light.h)
 *   error            how wrong the picture may be (common/accuracy/accuracy.h); null: not known
 *   health           what went wrong with single samples, also where it is too little to be seen: count and share
 *   audit            how many of its units another worker had rendered again when it was done, with the same bits
 *   work             what was counted (WORK_COUNTERS of common/film/unit.h); CPU time
 *   time             share of each stage (stages.h), and the number of samples of the threads' work
 *
 * Most effects that ran have a share of the time, too; the share of no effect is in `time`.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/film/unit.h"
#include "common/scene/scene_effects.h"
#include "common/scene/stages.h"

enum { MANIFEST_VERSION = 1 };
#define MANIFEST_EXTENSION "effects.json"

/* The caller keeps ownership of everything that it points to. Texts may hold any bytes. */
struct manifest {
    const char *job_name, *scene_name, *scene_digest, *renderer;
    uint64_t job;
    uint32_t frame;
    uint64_t effects;                  /* what ran */
    uint64_t called_for;               /* what would have run if nothing had been switched off */
    uint64_t without;                  /* what was switched off, needed or not */
    const struct effect_cause *causes; /* [EFFECT_COUNT] of `called_for`; NULL: not known */
    uint64_t frame_samples; /* over all pixels */
    int complete;           /* all that were requested */
    struct { uint32_t least; double mean; uint32_t most; } pixel_samples; /* of one pixel */
    uint32_t tiles_empty;   /* tiles without any sample */
    uint32_t max_depth;
    int depth_known;
    struct depth_report depth;
    int error_known;
    struct { double display, display_all, worst_part, fireflies, subject; } error;
    uint32_t audited; /* units that another worker rendered again with the same bits, in the coordinator's run */
    const struct health_row *health_rows; /* [HEALTH_KINDS], names of its counters */
    const struct unit_work *work;         /* NULL: nothing is counted, and nothing went wrong */
    uint64_t cpu_ns;                      /* measured; less than the frame took after a restart */
    uint64_t stages[STAGE_COUNT];
    uint64_t accounts[EFFECT_ACCOUNTS]; /* what is charged to an effect that did not run, or that
                                           has no account of its own, counts as no effect's */
};

/* Append the JSON, with a newline at its end. buffer_ok tells whether memory was sufficient. */
void manifest_write(struct buffer *out, const struct manifest *manifest);

/* Append `text` as a JSON string with its quotes; what is not UTF-8 becomes U+FFFD. */
void manifest_write_text(struct buffer *out, const char *text);
