/* fetch: outputs of a job, from the coordinator into files. */
#ifndef AZULEJO_CLIENT_FETCH_H
#define AZULEJO_CLIENT_FETCH_H

#include "client/connection.h"
#include "common/base/buffer.h"

/* An 8 GiB output is 26,000 pixels square in 32-bit floats, far above what a job may have. */
#define FETCH_BYTES_MAX ((uint64_t)8 << 30)

/* Append one output file to `data`. */
status fetch_output(struct connection *c, uint64_t job, uint32_t frame,
                    Azulejo__Wire__OutputKind kind, struct buffer *data, struct error *err) MUST_CHECK;

/* Make the folder and prove that files can be written there, before anything costly is
 * done. ERR_IO. */
status fetch_check_folder(const char *folder, struct error *err) MUST_CHECK;

#endif
