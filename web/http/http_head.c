/* What the library holds of a request's headers, as texts of ours: it may forget them before the answer. */
#include <stdio.h>
#include <string.h>

#include "web/http/http_parts.h"

const char *const http_kept_names[HTTP_KEPT_MAX] = {
    "if-none-match", "last-event-id", "content-type", "accept", "range", "user-agent", "content-length", "origin",
    "accept-encoding",
};
static const enum lws_token_indexes kept_tokens[HTTP_KEPT_MAX] = {
    WSI_TOKEN_HTTP_IF_NONE_MATCH, WSI_TOKEN_COUNT, WSI_TOKEN_HTTP_CONTENT_TYPE, WSI_TOKEN_HTTP_ACCEPT,
    WSI_TOKEN_HTTP_RANGE, WSI_TOKEN_HTTP_USER_AGENT, WSI_TOKEN_HTTP_CONTENT_LENGTH, WSI_TOKEN_ORIGIN,
    WSI_TOKEN_HTTP_ACCEPT_ENCODING,
};

/* ---- the library's headers ------------------------------------------------------------------- */

/* The header's value, added to `texts` with its 0; the place of it, or SIZE_MAX: none. Its bytes hold no 0. */
static size_t take_token(struct lws *wsi, struct buffer *texts, enum lws_token_indexes token)
{
    const int length = lws_hdr_total_length(wsi, token);
    const size_t at = texts->size;
    char *space;

    if (length <= 0 || !(space = (char *)buffer_append_space(texts, (size_t)length + 1)))
        return SIZE_MAX;
    space[0] = 0;
    if (lws_hdr_copy(wsi, space, length + 1, token) < 0)
        space[0] = 0;
    texts->size = at + strlen(space) + 1;
    return at;
}

static size_t take_custom(struct lws *wsi, struct buffer *texts, const char *name)
{
    const int length = lws_hdr_custom_length(wsi, name, (int)strlen(name));
    const size_t at = texts->size;
    char *space;

    if (length <= 0 || !(space = (char *)buffer_append_space(texts, (size_t)length + 1)))
        return SIZE_MAX;
    space[0] = 0;
    if (lws_hdr_custom_copy(wsi, space, length + 1, name, (int)strlen(name)) < 0)
        space[0] = 0;
    texts->size = at + strlen(space) + 1;
    return at;
}

int http_head_read(struct lws *wsi, struct http_head *head)
{
    *head = (struct http_head){.texts = BUFFER_INIT};
    head->host = take_token(wsi, &head->texts, WSI_TOKEN_HOST);
    head->origin = take_token(wsi, &head->texts, WSI_TOKEN_ORIGIN);
    head->site = take_custom(wsi, &head->texts, "sec-fetch-site:");
    head->mode = take_custom(wsi, &head->texts, "sec-fetch-mode:");
    head->authorization = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_AUTHORIZATION);
    head->cookie = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_COOKIE);
    head->transfer = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_TRANSFER_ENCODING);
    head->expect = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_EXPECT);
    head->version = take_token(wsi, &head->texts, WSI_TOKEN_HTTP);
    head->connection = take_token(wsi, &head->texts, WSI_TOKEN_CONNECTION);
    head->length = take_token(wsi, &head->texts, WSI_TOKEN_HTTP_CONTENT_LENGTH);
    return buffer_ok(&head->texts);
}

/* The texts move while they grow: first their places, then pointers. */
int http_take_texts(struct http_connection *c, struct http_request *request, const char *uri, size_t uri_size,
                    char **path)
{
    size_t kept[HTTP_KEPT_MAX], query[HTTP_QUERY_MAX], queries = 0;
    struct buffer *texts = &request->texts;
    const char *base;

    buffer_append(texts, uri, uri_size);
    buffer_append(texts, "", 1); /* the route's finder cuts this one */
    buffer_append(texts, uri, uri_size);
    buffer_append(texts, "", 1);
    for (size_t i = 0; i < HTTP_KEPT_MAX; i++) {
        char name[32];
        snprintf(name, sizeof name, "%s:", http_kept_names[i]);
        kept[i] = kept_tokens[i] == WSI_TOKEN_COUNT ? take_custom(c->wsi, texts, name)
                                                    : take_token(c->wsi, texts, kept_tokens[i]);
    }
    for (int i = 0; i < HTTP_QUERY_MAX; i++) {
        const int length = lws_hdr_fragment_length(c->wsi, WSI_TOKEN_HTTP_URI_ARGS, i);
        const size_t at = texts->size;
        char *space = length > 0 ? (char *)buffer_append_space(texts, (size_t)length + 1) : NULL;
        if (!space)
            break;
        space[0] = 0;
        if (lws_hdr_copy_fragment(c->wsi, space, length + 1, WSI_TOKEN_HTTP_URI_ARGS, i) < 0)
            space[0] = 0;
        texts->size = at + strlen(space) + 1;
        query[queries++] = at;
    }
    if (!buffer_ok(texts) || memchr(uri, 0, uri_size) ||
        lws_hdr_fragment_length(c->wsi, WSI_TOKEN_HTTP_URI_ARGS, HTTP_QUERY_MAX) > 0)
        return 0;
    base = (const char *)texts->data;
    *path = (char *)texts->data;
    request->base.path = base + uri_size + 1;
    for (size_t i = 0; i < HTTP_KEPT_MAX; i++)
        request->kept[i] = kept[i] == SIZE_MAX ? NULL : base + kept[i];
    for (size_t i = 0; i < queries; i++)
        request->query[i] = base + query[i];
    return 1;
}
