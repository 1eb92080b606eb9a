/* destination: the destination of render's pictures. */
#ifndef AZULEJO_CLIENT_DESTINATION_H
#define AZULEJO_CLIENT_DESTINATION_H

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

struct destination {
    char *folder, *base;  /* owned; base is the file's name without extension */
    unsigned formats;     /* enum output_format */
    int numbered;         /* several frames: the frame's number goes into the name */
    const char *jpeg_extension; /* as the user writes it: "jpg" or "jpeg" */
};

/* From -o: a path that ends in .exr, .png or .jpg is that one file, a folder (an existing one, or a
 * path that ends in '/') gets files named after the scene, anything else is the files' path without
 * extension. NULL: files in the current folder, named after the scene. `formats`: the files to
 * write, 0 for the usual two if the path does not decide. ERR_USAGE if path and formats disagree;
 * ERR_NO_MEMORY. */
status destination_init(struct destination *d, const char *out, unsigned formats,
                        const char *scene_name, uint32_t frames, struct error *err) MUST_CHECK;
void destination_release(struct destination *d);

/* Append a frame's path: FOLDER/BASE.EXT, or FOLDER/BASE-0001.EXT when numbered. */
void destination_path(const struct destination *d, uint32_t frame, const char *extension,
                      struct buffer *path);

#endif
