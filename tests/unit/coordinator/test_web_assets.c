/* The page's files: which there are, and in which form a browser gets them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>
#include <zlib.h>

#include "web/api/assets.h"

static void files_are_packed_as_they_are(void **state)
{
    static unsigned char plain[1 << 20];

    (void)state;
    assert_non_null(web_asset_find("index.html"));
    assert_null(web_asset_find("../web.c"));
    for (size_t i = 0; i < web_asset_file_count; i++) {
        const struct web_asset_file *file = &web_asset_files[i];
        z_stream z = {.next_in = (unsigned char *)file->packed, .avail_in = (unsigned)file->packed_size,
                      .next_out = plain, .avail_out = sizeof plain};

        assert_int_equal(inflateInit2(&z, 16 + MAX_WBITS), Z_OK);
        assert_int_equal(inflate(&z, Z_FINISH), Z_STREAM_END);
        assert_int_equal(inflateEnd(&z), Z_OK);
        assert_int_equal(z.total_out, file->size);
        assert_memory_equal(plain, file->data, file->size);
    }
}

static void gzip_is_sent_to_those_who_take_it(void **state)
{
    (void)state;
    assert_true(web_accepts_gzip("gzip"));
    assert_true(web_accepts_gzip("deflate, gzip;q=0.5, br"));
    assert_false(web_accepts_gzip(NULL));
    assert_false(web_accepts_gzip(""));
    assert_false(web_accepts_gzip("br, identity"));
    assert_false(web_accepts_gzip("br, gzip;q=0"));
    assert_false(web_accepts_gzip("gzipped"));
}

static void an_etag_is_found_among_others(void **state)
{
    (void)state;
    assert_true(web_etag_matches("\"a\", W/\"b-gz\"", "\"b-gz\""));
    assert_true(web_etag_matches("*", "\"b\""));
    assert_false(web_etag_matches("\"b-gz\"", "\"b\""));
    assert_false(web_etag_matches(NULL, "\"b\""));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(files_are_packed_as_they_are),
        cmocka_unit_test(gzip_is_sent_to_those_who_take_it),
        cmocka_unit_test(an_etag_is_found_among_others),
    };
    return cmocka_run_group_tests_name("web_assets", tests, NULL, NULL);
}
