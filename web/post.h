/* post: `azulejo-web post`, which sends one event of a webhook by libcurl and ends. The coordinator runs it for each
 * (coordinator/page/webhook_post.h, which says what it reads): what a foreign server answers reaches nothing else.
 *
 * Redirects are not followed, answers are not read, no proxy is used, and only http and https are spoken.
 */
#pragma once

/* The exit status: 0 if a server took it. */
int web_post_main(void);
