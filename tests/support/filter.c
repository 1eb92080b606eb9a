/* TEST_FILTER=NAME runs only that function of a test program; * and ? match as in file names. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

__attribute__((constructor)) static void filter_read(void) { cmocka_set_test_filter(getenv("TEST_FILTER")); }
