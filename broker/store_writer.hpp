// The thread that writes to the store, so that the broker's own never waits for a disk.
#pragma once

#include "broker/store.hpp"
#include "common/base/instant.hpp"
#include "common/net/waker.hpp"

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

namespace fraja::broker {

/// Everything up to there is in the store: as `synced` where it is a PutJob, PutPhase or ForgetJob
/// or comes before one that is, else as `written`.
struct Committed {
    std::uint64_t sequence = 0;
    friend bool operator==(const Committed&, const Committed&) = default;
};
/// The store cannot be written to; it is tried again and again. Told when the reason changes.
struct StoreTrouble {
    std::string reason;
    friend bool operator==(const StoreTrouble&, const StoreTrouble&) = default;
};
/// The trouble is over.
struct StoreRecovered {
    friend bool operator==(const StoreRecovered&, const StoreRecovered&) = default;
};

using StoreNews = std::variant<Committed, StoreTrouble, StoreRecovered>;

struct WriterOptions {
    std::uint64_t batch_bytes_max = std::uint64_t{8}
                                    << 20;             ///< in one transaction, but for its last
    Duration retry_pause = std::chrono::seconds(2);    ///< in trouble
    Duration stop_patience = std::chrono::seconds(10); ///< for what is queued when it is to stop
};

/// What a writer has done so far.
struct WriterTotals {
    std::uint64_t commits = 0, failed_commits = 0;
    std::uint64_t bytes = 0; ///< that were committed
    friend bool operator==(const WriterTotals&, const WriterTotals&) = default;
};

/// What is handed in while one transaction runs becomes the next. Nothing is dropped: in trouble
/// the queue grows, and its owner may look at how large it is. Only then jobs that are to be
/// forgotten go before their turn, since what cannot be written may need their space.
class StoreWriter {
public:
    /// `waker` is woken when there is news, and must outlive this.
    StoreWriter(Store store, const net::Waker& waker, WriterOptions options = {});
    /// As stop().
    ~StoreWriter();

    /// Sequences must grow, from 1 at least.
    void enqueue(Write write, std::uint64_t sequence);
    /// What happened since the last call, in order; of several Committed in a row the last.
    [[nodiscard]] std::vector<StoreNews> take_news();
    /// Of what is not committed.
    [[nodiscard]] std::uint64_t queued_bytes() const;
    [[nodiscard]] WriterTotals totals() const;
    /// Store::limit_file, before the next transaction.
    void limit_file(std::uint64_t bytes_max);

    /// Commits what is queued, for as long as `stop_patience` where that does not go well, and ends
    /// the thread. Whether everything is in. Nothing may be queued after it.
    bool stop();

private:
    using Clock = std::chrono::steady_clock;
    struct Queued {
        Write write;
        std::uint64_t sequence = 0;
    };
    struct Batch {
        std::vector<Write> writes;
        std::uint64_t bytes = 0;
        std::uint64_t sequence = 0; ///< of the last: everything up to there is in when this is
        Durability durability = Durability::written;
    };

    void run();
    /// Waits for something to do. Nothing: it is to stop, and nothing is left or no time.
    [[nodiscard]] std::optional<Batch> next_batch();
    [[nodiscard]] Result<void> try_commit(const Batch& batch);
    /// By what is forgotten in the batch and behind it, each once.
    void make_room(const Batch& batch);
    void tell_committed(const Batch& batch);
    void tell_trouble(const std::string& reason);
    /// False: it is to stop, and there is no time left.
    [[nodiscard]] bool wait_to_retry();
    [[nodiscard]] bool out_of_time() const { return stop_by_ && Clock::now() >= *stop_by_; }
    void tell(StoreNews news);

    Store store_;                       ///< the thread's alone, as is the next
    std::uint64_t room_made_up_to_ = 0; ///< by the ForgetJobs up to that sequence
    const net::Waker& waker_;
    const WriterOptions options_;

    mutable std::mutex mutex_; ///< of what follows
    std::condition_variable changed_;
    std::deque<Queued> queue_;
    std::uint64_t queued_bytes_ = 0; ///< of the queue and of the batch on its way
    std::uint64_t last_sequence_ = 0;
    WriterTotals totals_;
    std::vector<StoreNews> news_;
    std::string trouble_; ///< the reason that was told; empty: all is well
    std::optional<std::uint64_t> file_bytes_max_;
    std::optional<Clock::time_point> stop_by_;

    std::jthread thread_; // last: it uses the rest
};

} // namespace fraja::broker
