// guarded: where exceptions of libraries and of the system end.
#pragma once

#include "common/base/result.hpp"

#include <exception>
#include <new>
#include <string>

namespace fraja {

/// What `deed` returns, a Result; an exception becomes an error of this machine's, ErrorCode::io.
/// For what runs in a thread of its own, where an exception would end the program.
template <class F>
auto guarded(F deed) -> decltype(deed()) {
    try {
        return deed();
    } catch (const std::bad_alloc&) {
        return Error{ErrorCode::io, "out of memory"};
    } catch (const std::exception& e) {
        return Error{ErrorCode::io, std::string("unexpected: ") + e.what()};
    }
}

} // namespace fraja
