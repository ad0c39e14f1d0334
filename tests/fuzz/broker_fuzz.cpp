// The broker's core alone: see broker_world.hpp.
#include "tests/fuzz/broker_world.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    fraja::fuzz::Input in(data, size);
    fraja::fuzz::World(in, fraja::fuzz::Company::none).run();
    return 0;
}
