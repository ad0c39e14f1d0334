#include "common/base/freed_memory.hpp"

#include "common/base/bytes.hpp"
#include "tests/support/resident.hpp"

#include <doctest/doctest.h>
#include <thread>
#include <unistd.h>
#include <vector>

using namespace fraja;

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

namespace {

struct Resident {
    double before, held, freed;
};

/// Of a thread that takes 286 MiB in pieces and frees them.
Resident take_and_free() {
    Resident mib{};
    std::jthread([&] {
        mib.before = resident_mib(getpid());
        std::vector<Bytes> pieces;
        pieces.reserve(3'000); // nothing else lies between them
        for (int i = 0; i < 3'000; ++i)
            pieces.emplace_back(100'000, std::byte{1});
        mib.held = resident_mib(getpid());
        pieces = {};
        mib.freed = resident_mib(getpid());
    }).join();
    CHECK(mib.held > mib.before + 280);
    return mib;
}

} // namespace

TEST_CASE("of what a thread frees so much is kept, and the rest given back") {
    keep_freed_memory(std::size_t{16} << 20);
    const Resident mib = take_and_free();
    CHECK(mib.freed > mib.before + 3);
    CHECK(mib.freed < mib.before + 16 + 64 + 8); // and a part of 64 MiB that something lies in
}

TEST_CASE("all that a thread frees can be kept") {
    keep_all_freed_memory();
    const Resident mib = take_and_free();
    CHECK(mib.freed > mib.held - 8);
    give_back_freed_memory();
    CHECK(resident_mib(getpid()) < mib.before + 64 + 8); // but for what lies at an arena's end
}

#endif
