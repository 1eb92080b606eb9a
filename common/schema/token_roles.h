/* token_roles: what people's keys, and tokens of the page and its API, may do: each role once.
 *
 * ROLE(NAME, name, number): the word, and the wire's and the store's number. Each may do what those before it may;
 * requests.h says what that is. */
#pragma once

#define TOKEN_ROLES(ROLE)    \
    ROLE(NONE, none, 0)      \
    ROLE(VIEW, view, 1)      \
    ROLE(SUBMIT, submit, 2)  \
    ROLE(OPERATE, operate, 3) \
    ROLE(ADMIN, admin, 4)

enum web_role {
#define ROLE(NAME, name, number) WEB_ROLE_##NAME = number,
    TOKEN_ROLES(ROLE)
#undef ROLE
    WEB_ROLES
};

/* The option tables' list: "view|submit|operate|admin". */
#define TOKEN_ROLE_WORDS (&(TOKEN_ROLES(TOKEN_ROLE_WORD_OF))[sizeof "|none"])
#define TOKEN_ROLE_WORD_OF(NAME, name, number) "|" #name

/* "view"; "none" for what is no role. */
const char *web_role_name(enum web_role role);
/* NONE: the word is no role. */
enum web_role web_role_parse(const char *word);
