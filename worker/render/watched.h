/* watched: a byte that its own thread writes often, and another thread looks at now and then.
 *
 * Relaxed atomics would say just that, but compilers take every atomic access for a barrier to all
 * memory and reload what they had in registers: that made frames longer by 1 %. A volatile byte
 * is stored whole by every processor; the thread sanitizer, which cannot know, gets the atomic.
 */
#ifndef AZULEJO_RENDER_WATCHED_H
#define AZULEJO_RENDER_WATCHED_H

#include <stdint.h>

#if defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define WATCHED_ATOMIC 1
#endif
#endif
#if defined(__SANITIZE_THREAD__) && !defined(WATCHED_ATOMIC)
#define WATCHED_ATOMIC 1
#endif

#ifdef WATCHED_ATOMIC
#include <stdatomic.h>
typedef _Atomic uint8_t watched_byte;
#define WATCHED_GET(byte) atomic_load_explicit(&(byte), memory_order_relaxed)
#define WATCHED_SET(byte, value) atomic_store_explicit(&(byte), value, memory_order_relaxed)
#else
typedef volatile uint8_t watched_byte;
#define WATCHED_GET(byte) (byte)
#define WATCHED_SET(byte, value) ((void)((byte) = (value)))
#endif

#endif
