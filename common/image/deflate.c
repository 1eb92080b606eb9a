#include "common/image/deflate.h"

#include <libdeflate.h>
#include <pthread.h>

#include "common/base/memory.h"

struct deflater {
    struct libdeflate_compressor *compressor;
};

static void use_our_memory(void) { libdeflate_set_memory_allocator(mem_alloc, mem_free); }

struct deflater *deflater_new(int level)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    struct deflater *d = mem_alloc(sizeof *d);

    pthread_once(&once, use_our_memory);
    if (!d)
        return NULL;
    d->compressor = libdeflate_alloc_compressor(level);
    if (d->compressor)
        return d;
    mem_free(d);
    return NULL;
}

void deflater_free(struct deflater *d)
{
    if (!d)
        return;
    libdeflate_free_compressor(d->compressor);
    mem_free(d);
}

void deflater_append(struct deflater *d, const uint8_t *data, size_t size_bytes, struct buffer *out)
{
    size_t start = out->size, most = libdeflate_zlib_compress_bound(d->compressor, size_bytes);
    uint8_t *to = buffer_append_space(out, most);

    if (to)
        out->size = start + libdeflate_zlib_compress(d->compressor, data, size_bytes, to, most);
}

uint32_t deflate_crc32(uint32_t crc, const uint8_t *data, size_t size_bytes)
{
    return libdeflate_crc32(crc, data, size_bytes);
}
