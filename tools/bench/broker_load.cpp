#include "tools/bench/broker_load.hpp"

#include "common/base/assert.hpp"
#include "common/protocol/packing.hpp"
#include "common/protocol/topics.hpp"

#include <utility>
#include <vector>
#include <zmq.hpp>

namespace fraja {
namespace {

using namespace protocol;
using namespace std::chrono_literals;

constexpr int queue_max = 10'000;
constexpr auto patience = 100ms; // then it is asked whether all is over

std::string text_of(const Bytes& bytes) {
    return std::string(as_text(bytes));
}

zmq::socket_t open(zmq::context_t& context, zmq::socket_type type) {
    zmq::socket_t socket(context, type);
    socket.set(zmq::sockopt::linger, 0);
    if (type != zmq::socket_type::sub)
        socket.set(zmq::sockopt::sndhwm, queue_max);
    socket.set(zmq::sockopt::rcvhwm, type == zmq::socket_type::sub ? 0 : queue_max);
    return socket;
}

/// Never waits. False: there is nothing.
bool receive(zmq::socket_t& socket, std::vector<zmq::message_t>& frames) {
    frames.clear();
    do {
        zmq::message_t frame;
        if (!socket.recv(frame, zmq::recv_flags::dontwait))
            return false;
        frames.push_back(std::move(frame));
    } while (frames.back().more());
    return true;
}

void send(zmq::socket_t& socket, const Packet& packet) {
    zmq::message_t message(packed_size(packet));
    pack(packet, {static_cast<std::byte*>(message.data()), message.size()});
    FRAJA_ASSERT(socket.send(message, zmq::send_flags::none));
}

/// Of a message on a session, for as long as `message` is there.
std::vector<Blob> frames_of(const zmq::message_t& message) {
    return unpack({nullptr, {static_cast<const std::byte*>(message.data()), message.size()}});
}

/// What is polled, and when it has something.
void wait(std::vector<zmq::pollitem_t>& items) {
    zmq::poll(items, patience);
}

std::vector<zmq::pollitem_t> items_of(std::vector<zmq::socket_t>& sockets) {
    std::vector<zmq::pollitem_t> items;
    for (zmq::socket_t& socket : sockets)
        items.push_back({socket.handle(), 0, ZMQ_POLLIN, 0});
    return items;
}

/// Of msgpack's unsigned integers.
std::size_t length_of_number(char first) {
    switch (static_cast<unsigned char>(first)) {
    case 0xcc:
        return 2;
    case 0xcd:
        return 3;
    case 0xce:
        return 5;
    default:
        return 1;
    }
}

} // namespace

std::uint16_t message_type(std::string_view header) {
    if (header.size() != 8)
        return 0;
    return static_cast<std::uint16_t>(static_cast<unsigned char>(header[6]) |
                                      static_cast<unsigned char>(header[7]) << 8);
}

/// Both arrays begin with job, tile and attempt; what follows is the same in every answer. So
/// nothing need be decoded.
std::string answer_to(std::string_view order) {
    constexpr std::size_t array = 1, job = 2 + 16;
    static const std::string answer = text_of(encode(TileRendered{.job = {},
                                                                  .tile = {},
                                                                  .attempt = {},
                                                                  .rays = {.camera = 1000},
                                                                  .elapsed = 1ms,
                                                                  .blobs = {Blob()}})
                                                  .body);
    std::size_t end = array + job;
    end += length_of_number(order[end]);
    end += length_of_number(order[end]);
    return answer.substr(0, array) + std::string(order.substr(array, end - array)) +
           answer.substr(array + job + 2);
}

// ---------------------------------------------------------------------------------------- workers

WorkerLoad::WorkerLoad(std::string endpoint, const LoadOptions& options)
    : options_(options), thread_([this, endpoint = std::move(endpoint)](
                                     const std::stop_token& stop) { run(stop, endpoint); }) {}

double WorkerLoad::orders_per_s() const {
    const std::uint32_t counted = options_.tiles - options_.tiles / 10;
    return counted / std::chrono::duration<double>(end_ - begin_).count();
}

void WorkerLoad::count_order() {
    const std::uint32_t order = orders_ + 1;
    if (order == options_.tiles / 10)
        begin_ = BenchClock::now();
    if (order == options_.tiles)
        end_ = BenchClock::now();
    orders_ = order;
}

void WorkerLoad::run(const std::stop_token& stop, const std::string& endpoint) {
    zmq::context_t context;
    std::vector<zmq::socket_t> sockets;
    for (std::uint32_t i = 0; i < options_.workers; ++i) {
        sockets.push_back(open(context, zmq::socket_type::dealer));
        if (const auto& keys = options_.keys) {
            sockets.back().set(zmq::sockopt::curve_serverkey, keys->broker.text);
            sockets.back().set(zmq::sockopt::curve_publickey, keys->own.public_key.text);
            sockets.back().set(zmq::sockopt::curve_secretkey, keys->own.secret.text());
        }
        sockets.back().connect(endpoint);
        const Packet hello = encode(WorkerHello{.worker = random_id<WorkerId>(),
                                                .incarnation = 1,
                                                .worker_name = "worker-" + std::to_string(i),
                                                .threads = 1,
                                                .credit = options_.credit,
                                                .tags = {},
                                                .program_version = "bench"});
        send(sockets.back(), hello);
    }
    Packet answer = encode(TileRendered{.job = {}, .rays = {}, .blobs = {Blob()}});
    answer.blobs = {Blob(Bytes(options_.tile_bytes))};
    std::vector<zmq::pollitem_t> items = items_of(sockets);
    std::vector<zmq::message_t> frames;
    while (!stop.stop_requested()) {
        wait(items);
        for (std::size_t i = 0; i < sockets.size(); ++i) {
            if ((items[i].revents & ZMQ_POLLIN) == 0)
                continue;
            while (receive(sockets[i], frames)) {
                const std::vector<Blob> order = frames_of(frames[0]);
                const std::uint16_t type = message_type(as_text(order[0]));
                if (type == Welcome::type)
                    ++welcomes_;
                if (type != RenderTile::type)
                    continue;
                count_order();
                answer.body = to_bytes(answer_to(as_text(order[1])));
                send(sockets[i], answer);
            }
        }
    }
}

// --------------------------------------------------------------------------------------- watchers

WatcherLoad::WatcherLoad(std::string stream, std::uint32_t count, const JobId& job)
    : count_(count), thread_([this, stream = std::move(stream), job](const std::stop_token& stop) {
          run(stop, stream, job);
      }) {
    while (ready_ < count)
        std::this_thread::sleep_for(1ms);
}

void WatcherLoad::run(const std::stop_token& stop, const std::string& stream, const JobId& job) {
    zmq::context_t context;
    std::vector<zmq::socket_t> sockets;
    for (std::uint32_t i = 0; i < count_; ++i) {
        sockets.push_back(open(context, zmq::socket_type::sub));
        sockets.back().connect(stream);
        sockets.back().set(zmq::sockopt::subscribe, job_topic(job));
        sockets.back().set(zmq::sockopt::subscribe, barrier_topic(random_id<Nonce>()));
    }
    std::vector<zmq::pollitem_t> items = items_of(sockets);
    std::vector<zmq::message_t> frames;
    while (!stop.stop_requested()) {
        wait(items);
        for (std::size_t i = 0; i < sockets.size(); ++i)
            while ((items[i].revents & ZMQ_POLLIN) != 0 && receive(sockets[i], frames)) {
                const std::uint16_t type = message_type(frames[1].to_string_view());
                ready_ += type == Barrier::type ? 1 : 0;
                tiles_ += type == TileDone::type ? 1 : 0;
            }
    }
}

// ------------------------------------------------------------------------------------ the bare
// loop

double bare_orders_per_s(const LoadOptions& options) {
    zmq::context_t context;
    zmq::socket_t router = open(context, zmq::socket_type::router);
    router.set(zmq::sockopt::router_mandatory, true);
    router.bind("tcp://127.0.0.1:*");
    const Packet order = encode(RenderTile{.job = random_id<JobId>(),
                                           .tile = TileIndex{100'000},
                                           .attempt = AttemptNumber{100'000},
                                           .rect = {1000, 1000, 45, 45},
                                           .scene = {},
                                           .scene_bytes = 1000,
                                           .settings = {.size = {10'000, 10'000}}});
    const WorkerLoad load(router.get(zmq::sockopt::last_endpoint), options);
    std::uint32_t sent = 0;
    std::vector<zmq::message_t> frames;
    std::vector<zmq::pollitem_t> items{{router.handle(), 0, ZMQ_POLLIN, 0}};
    while (load.orders() < options.tiles) {
        wait(items);
        while (receive(router, frames)) {
            const bool hello = message_type(as_text(frames_of(frames[1])[0])) == WorkerHello::type;
            for (std::uint32_t i = 0; i < (hello ? options.credit : 1) && sent < options.tiles;
                 ++i, ++sent) {
                FRAJA_ASSERT(router.send(zmq::const_buffer(frames[0].data(), frames[0].size()),
                                         zmq::send_flags::sndmore));
                send(router, order);
            }
        }
    }
    return load.orders_per_s();
}

} // namespace fraja
