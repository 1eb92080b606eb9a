/* token_end: that tokens are used, and end. */
#pragma once

#include <stdint.h>

struct page;

/* Once a second tokens expire, and the store learns which were used. At each tick of the server. */
void token_end_tick(struct page *page, uint64_t now_ns);
