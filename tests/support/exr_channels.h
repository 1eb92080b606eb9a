/* exr_channels: any channel of an OpenEXR file in memory, read by OpenEXR itself. */
#pragma once

#include <stddef.h>
#include <stdint.h>

/* [height][width] floats of the channel, to be freed with free(); NULL when the file has it not.
 * *half tells how they are stored. Fails the running test on a file that OpenEXR refuses. */
float *exr_channel_read(const void *data, size_t size, const char *name, int *half);
int exr_channel_count(const void *data, size_t size);
