/* page: what the coordinator keeps and does for the page and its API, whose program azulejo-web is a client in a
 * process of its own: tokens, figures, and telling it what changes. A guest of the server (net/guest.h).
 *
 *   page_new --guest.start--> keeper.h starts the program --PageBegin--> it is served --guest.stop--> page_free
 *
 * What the program gets is in messages alone: no key but its own role's, no file of the store, no film.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/net/guest.h"
#include "coordinator/page/keeper.h"
#include "coordinator/page/metrics.h"

enum { PAGE_LINK_MAX = PAGE_URL_MAX + 160 };

struct feed;
struct token_answer;
struct watching;
struct web_tokens;

struct page_state {
    int ending;
    char store_why[256];
    uint64_t uploads_max, store_limit;
};

struct page {
    struct page_options options;
    struct server *server; /* from start to stop */
    struct keeper *keeper; /* NULL: somebody else starts the program */
    struct web_tokens *tokens;
    uint64_t tokens_version, tokens_taken, tokens_ticked_ns; /* taken: the page knows them */
    struct token_answer *answers;                            /* that wait until the page knows of a change */
    int sessions_end;                                        /* some session's token has ended */
    struct metrics metrics;
    struct feed *feed;
    struct watching *watching;
    uint32_t follower;           /* the session of the page's program; 0: none */
    struct page_state sent;      /* to it, last */
    int is_published;            /* it knows the tokens: it can be used */
    int was_there;               /* it was published before: its address was printed */
    int link_writes, link_stale; /* a task writes STORE/page.url; it is to be written again after that, */
    int link_prints;             /* and then to be printed */
    int is_renewing;             /* the coordinator's own token */
    uint16_t port;
    char fingerprint[128]; /* of its certificate; "": none */
    struct error why;      /* why it cannot listen */
};

/* The options' texts are the caller's and stay. ERR_NO_MEMORY. */
status page_new(struct page **out, const struct page_options *options, struct error *err) MUST_CHECK;
struct server_guest page_guest(struct page *page);
/* After the server's loop has ended; NULL is fine. */
void page_free(struct page *page);

/* Send the page its tokens. The version of what was sent; 0: it is not there. */
uint64_t page_tell_tokens(struct page *page);
/* The line of STORE/page.url: the address with that token. Empty while the page has no address. */
void page_link(const struct page *page, const char *token, char line[PAGE_LINK_MAX]);
/* Have STORE/page.url written, with the coordinator's own token as it is now; `prints`: then print it. */
void page_link_renew(struct page *page, int prints);
/* Write STORE/page.url, from any thread. ERR_IO, ERR_NO_MEMORY. */
status page_link_write(const struct page *page, const char *line, struct error *err) MUST_CHECK;
