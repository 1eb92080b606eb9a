/* remake: frames whose files were found damaged on disk are made again, with the same bits.
 *
 *   its film is kept           the frame goes on from it (extend.h), is complete at once, and is developed as before;
 *                              tiles that are damaged in the film, too, are rendered again
 *   it is not, a PNG or JPEG   developed again from the stored picture
 *   otherwise                  nothing: 'azulejo retry' renders the frame again, as fetch says
 *
 * A job that has not ended is looked at when it has. */
#pragma once

#include "coordinator/farm/farm.h"

/* Take what the store has noted (store_damage_take); call it at every tick. */
void remake_step(struct farm *farm, uint64_t now_ns);
