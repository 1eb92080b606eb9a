/* box_tree: which of many boxes overlap. Private to worker/render.
 *
 * A balanced binary tree, split at the median of the boxes' middles. Its shape depends only on
 * their number, so boxes of any mix of sizes work and many may lie at one place.
 */
#pragma once

#include "common/base/status.h"
#include "worker/render/render_scene.h"

/* Called for two boxes that overlap or touch. A result other than 0 ends the search. */
typedef int box_tree_visit(void *user, uint32_t a, uint32_t b);

/* Visit, once each, the pairs of overlapping `boxes` of which at least one asks. ERR_NO_MEMORY. */
status box_tree_pairs(const struct render_box *boxes, const uint8_t *asks, uint32_t count, box_tree_visit *visit,
                      void *user, struct error *err) MUST_CHECK;
