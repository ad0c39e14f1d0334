// Assertions: for our own mistakes, never for what the world sends.
#pragma once

namespace fraja::detail {
[[noreturn]] void assertion_failed(const char* condition, const char* file, int line);
} // namespace fraja::detail

/// Aborts with the condition and its place when `cond` is false, in every build.
#define FRAJA_ASSERT(cond)                                                                         \
    ((cond) ? static_cast<void>(0) : ::fraja::detail::assertion_failed(#cond, __FILE__, __LINE__))

/// The same for hot loops: off in release.
#ifdef NDEBUG
#define FRAJA_DEBUG_ASSERT(cond) static_cast<void>(0)
#else
#define FRAJA_DEBUG_ASSERT(cond) FRAJA_ASSERT(cond)
#endif
