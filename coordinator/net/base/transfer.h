/* transfer: sending a file or a buffer in pieces, no faster than the peer takes it.
 *
 * One queue for each session, served in order. It owns the waiting transfers.
 */
#pragma once

#include <stdint.h>

#include "common/base/digest.h"
#include "common/base/status.h"
#include "coordinator/frame/preview.h"
#include "protocol/channel.h"

enum { TRANSFERS_MAX = 4096 }; /* waiting, of one session */

struct transfer;

struct transfers {
    struct transfer *first, *last;
    uint32_t count;
};

void transfers_release(struct transfers *transfers);

/* The file at `path` as OutputData in answer to `request`. ERR_LIMIT, ERR_NO_MEMORY. A file that cannot be read is
 * answered with a Failure. */
status transfer_file(struct transfers *transfers, uint64_t request, const char *path, struct error *err) MUST_CHECK;
/* The blob as BlobData. One that is damaged is removed, and its last piece is a Failure (ERR_NOT_FOUND). `store` is its
 * folder, which must stay. */
status transfer_blob(struct transfers *transfers, uint64_t request, const char *store, const struct digest *digest,
                     struct error *err) MUST_CHECK;
/* The file as OutputData, with what is known of its bytes. */
status transfer_output(struct transfers *transfers, uint64_t request, const struct digest *digest, const char *path,
                       struct error *err) MUST_CHECK;
/* What a preview shows. */
struct transfer_preview {
    double covered; /* the share of its tiles that have samples */
    double samples; /* of a pixel, the mean */
};
/* The same, of a preview. */
status transfer_file_preview(struct transfers *transfers, uint64_t request, const char *path,
                             const struct transfer_preview *shows, struct error *err) MUST_CHECK;
/* A preview's bytes as OutputData; holds them until they are sent. */
status transfer_bytes(struct transfers *transfers, uint64_t request, struct preview_file *file, const char *file_name,
                      const struct transfer_preview *shows, struct error *err) MUST_CHECK;

/* Send what the channel takes now. */
void transfers_pump(struct transfers *transfers, struct channel *channel);
