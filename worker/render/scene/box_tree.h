/* box_tree: which of many boxes overlap. Private to worker/render.
 *
 * A balanced binary tree, halved at the median of the boxes' middles: its shape depends on their
 * number alone, so sizes may be mixed at will and many may lie at one place.
 */
#ifndef AZULEJO_RENDER_BOX_TREE_H
#define AZULEJO_RENDER_BOX_TREE_H

#include "common/base/status.h"
#include "worker/render/world.h"

/* Called for two boxes that overlap or touch; not 0: look no further. */
typedef int box_tree_visit(void *user, uint32_t a, uint32_t b);

/* Visit, once each, the pairs of `boxes` that overlap of which at least one asks. ERR_NO_MEMORY. */
status box_tree_pairs(const struct world_box *boxes, const uint8_t *asks, uint32_t count,
                      box_tree_visit *visit, void *user, struct error *err) MUST_CHECK;

#endif
