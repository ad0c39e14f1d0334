#include "common/net/frames.hpp"

#include <doctest/doctest.h>

using namespace fraja;
using namespace fraja::net;

TEST_CASE("a frame that libzmq has by itself is kept, one that may share its buffer is copied") {
    for (const std::size_t size : {std::size_t{1}, std::size_t{8'192}, std::size_t{8'193}}) {
        CAPTURE(size);
        zmq::message_t message(size);
        const void* received = message.data();
        const Blob blob = blob_of(std::move(message));
        CHECK(blob.size() == size);
        CHECK((blob.data() == received) == (size > 8'192));
    }
}
