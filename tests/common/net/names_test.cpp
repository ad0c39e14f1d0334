// Names of hosts that nobody knows, or not soon: looking them up holds up nobody else.
#include "common/net/clock.hpp"
#include "common/net/sockets.hpp"

#include <chrono>
#include <condition_variable>
#include <dlfcn.h>
#include <doctest/doctest.h>
#include <mutex>
#include <netdb.h>
#include <string_view>

using namespace fraja;
using namespace fraja::net;
using namespace std::chrono_literals;

namespace {

constexpr const char* slow_host = "slow.fraja.test";
constexpr const char* quick_host = "quick.fraja.test"; // this one

/// The question for `slow_host` is not answered before it is told to be.
class SlowName {
public:
    void begin() {
        const std::lock_guard lock(mutex_);
        is_asked_ = is_answered_ = false;
    }
    void be_asked() {
        std::unique_lock lock(mutex_);
        is_asked_ = true;
        changed_.notify_all();
        changed_.wait(lock, [this] { return is_answered_; });
    }
    void answer() {
        const std::lock_guard lock(mutex_);
        is_answered_ = true;
        changed_.notify_all();
    }
    void wait_until_asked() {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [this] { return is_asked_; });
    }

private:
    std::mutex mutex_;
    std::condition_variable changed_;
    bool is_asked_ = false, is_answered_ = false;
};
SlowName slow_name;

} // namespace

/// In the system library's place, for libzmq as well.
extern "C" int getaddrinfo(const char* node, const char* service, const addrinfo* hints,
                           addrinfo** found) {
    if (node && std::string_view(node) == slow_host) {
        slow_name.be_asked();
        return EAI_NONAME;
    }
    using Original = int (*)(const char*, const char*, const addrinfo*, addrinfo**);
    static const auto original = reinterpret_cast<Original>(dlsym(RTLD_NEXT, "getaddrinfo"));
    const bool is_quick = node && std::string_view(node) == quick_host;
    return original(is_quick ? "127.0.0.1" : node, service, hints, found);
}

TEST_CASE("while a name is looked up, all others are spoken to") {
    slow_name.begin();
    const Context context;
    auto router = RouterSocket::bind(context, "tcp://127.0.0.1:0");
    REQUIRE(router.has_value());
    std::string endpoint = router->endpoint();
    SUBCASE("by a number") {}
    SUBCASE("by another name") {
        endpoint.replace(endpoint.find("127.0.0.1"), 9, quick_host);
    }
    auto slow = DealerSocket::connect(context, std::string("tcp://") + slow_host + ":1");
    REQUIRE(slow.has_value());
    slow_name.wait_until_asked();
    auto dealer = DealerSocket::connect(context, endpoint);
    REQUIRE(dealer.has_value());
    std::optional<RoutedMessage> heard;
    for (const Instant end = net::now() + 20s; !heard && net::now() < end;) {
        (void)dealer->send({to_bytes("head"), to_bytes("body"), {}}); // once the connection stands
        net::wait({*router, *dealer}, 10ms);
        heard = router->receive();
    }
    slow_name.answer();
    CHECK(heard.has_value());
}
