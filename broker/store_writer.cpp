#include "broker/store_writer.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <utility>

namespace fraja::broker {

StoreWriter::StoreWriter(Store store, const net::Waker& waker, WriterOptions options)
    : store_(std::move(store)), waker_(waker), options_(options), thread_([this] { run(); }) {}

StoreWriter::~StoreWriter() {
    stop();
}

void StoreWriter::enqueue(Write write, std::uint64_t sequence) {
    const std::lock_guard lock(mutex_);
    FRAJA_ASSERT(sequence > last_sequence_ && !stop_by_);
    last_sequence_ = sequence;
    queued_bytes_ += size_bytes(write);
    queue_.push_back({std::move(write), sequence});
    changed_.notify_one();
}

std::vector<StoreNews> StoreWriter::take_news() {
    const std::lock_guard lock(mutex_);
    return std::exchange(news_, {});
}

std::uint64_t StoreWriter::queued_bytes() const {
    const std::lock_guard lock(mutex_);
    return queued_bytes_;
}

WriterTotals StoreWriter::totals() const {
    const std::lock_guard lock(mutex_);
    return totals_;
}

void StoreWriter::limit_file(std::uint64_t bytes_max) {
    const std::lock_guard lock(mutex_);
    file_bytes_max_ = bytes_max;
}

bool StoreWriter::stop() {
    {
        const std::lock_guard lock(mutex_);
        if (!stop_by_)
            stop_by_ = Clock::now() + options_.stop_patience;
        changed_.notify_one();
    }
    if (thread_.joinable())
        thread_.join();
    return queued_bytes() == 0;
}

// -------------------------------------------------------------------------------------- the thread

void StoreWriter::run() {
    while (const auto batch = next_batch()) {
        for (auto done = try_commit(*batch); !done; done = try_commit(*batch)) {
            tell_trouble(done.error().message);
            make_room(*batch);
            if (!wait_to_retry())
                return;
        }
        tell_committed(*batch);
    }
}

std::optional<StoreWriter::Batch> StoreWriter::next_batch() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return !queue_.empty() || stop_by_; });
    if (queue_.empty() || out_of_time())
        return std::nullopt;
    Batch batch;
    while (!queue_.empty() && batch.bytes < options_.batch_bytes_max) {
        Queued& next = queue_.front();
        batch.bytes += size_bytes(next.write);
        batch.sequence = next.sequence;
        if (wants_sync(next.write))
            batch.durability = Durability::synced;
        batch.writes.push_back(std::move(next.write));
        queue_.pop_front();
    }
    return batch;
}

Result<void> StoreWriter::try_commit(const Batch& batch) {
    std::optional<std::uint64_t> file_bytes_max;
    {
        const std::lock_guard lock(mutex_);
        file_bytes_max = std::exchange(file_bytes_max_, std::nullopt);
    }
    if (file_bytes_max)
        if (const auto set = store_.limit_file(*file_bytes_max); !set)
            return set;
    return store_.commit(batch.writes, batch.durability);
}

void StoreWriter::make_room(const Batch& batch) {
    std::vector<JobId> jobs;
    const auto add = [&](const Write& write) {
        if (const auto* forget = std::get_if<ForgetJob>(&write); forget && !forget->may_come_back)
            jobs.push_back(forget->job);
    };
    if (batch.sequence > room_made_up_to_)
        std::for_each(batch.writes.begin(), batch.writes.end(), add);
    std::uint64_t up_to = 0;
    {
        const std::lock_guard lock(mutex_);
        for (const Queued& queued : queue_)
            if (queued.sequence > room_made_up_to_)
                add(queued.write);
        up_to = last_sequence_;
    }
    // Where that, too, goes wrong, the reason is the one that was told.
    if (jobs.empty() || store_.make_room(jobs))
        room_made_up_to_ = up_to;
}

void StoreWriter::tell_committed(const Batch& batch) {
    const std::lock_guard lock(mutex_);
    queued_bytes_ -= batch.bytes;
    totals_.bytes += batch.bytes;
    ++totals_.commits;
    if (!trouble_.empty()) {
        trouble_.clear();
        tell(StoreRecovered{});
    }
    tell(Committed{batch.sequence});
}

void StoreWriter::tell_trouble(const std::string& reason) {
    const std::lock_guard lock(mutex_);
    ++totals_.failed_commits;
    if (reason == trouble_)
        return;
    trouble_ = reason;
    tell(StoreTrouble{reason});
}

void StoreWriter::tell(StoreNews news) {
    if (std::holds_alternative<Committed>(news) && !news_.empty() &&
        std::holds_alternative<Committed>(news_.back()))
        news_.pop_back();
    news_.push_back(std::move(news));
    waker_.wake();
}

bool StoreWriter::wait_to_retry() {
    std::unique_lock lock(mutex_);
    auto until = Clock::now() + options_.retry_pause;
    if (stop_by_)
        until = std::min(until, *stop_by_);
    const bool was_to_stop = stop_by_.has_value();
    changed_.wait_until(lock, until, [&] { return !was_to_stop && stop_by_; });
    return !out_of_time();
}

} // namespace fraja::broker
