/* picture_file: pictures in from EXR and HDR files, and out to PNG, JPEG and EXR files. */
#pragma once

#include "client/options/output.h"
#include "common/image/image.h"

/* Reports repairs on standard error. ERR_INPUT, ERR_LIMIT, ERR_UNSUPPORTED. */
status picture_read(struct image *out, const char *path, struct error *err) MUST_CHECK;

/* The layer `denoised` of an EXR instead. ERR_INPUT: it has none. */
status picture_read_denoised(struct image *out, const char *path, struct error *err) MUST_CHECK;
/* EXR files take display light, the others display codes. ERR_IO, ERR_LIMIT. */
status picture_write(const char *path, const struct image *image, enum output_format format,
                     const struct picture_options *how, struct error *err) MUST_CHECK;
