#include "dashpot/team.hpp"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "dashpot/aligned.hpp"

namespace dashpot {

namespace {

// How long a thread waits for a pass before it sleeps: longer than what a step does between two
// passes, and than a script does between two steps.
constexpr std::chrono::microseconds kPatience{500};
constexpr int kLooks = 64;  // between two looks at the clock
// How long the calling thread waits for others to take what is theirs, in looks: some microseconds,
// after which to move it into other caches is the lesser evil.
constexpr int kLooksBeforeTaking = 150;
// And for what they have begun, before others may have its processor: a thread that the system has
// stopped may wait for it.
constexpr int kLooksBeforeYielding = 5000;

// In place of the number of a pass that a thread has seen.
constexpr std::uint32_t kAsleep = 0xffffffffu;

void pause() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

}  // namespace

// A pass costs little more than two cache lines that go from one thread to the other: what is to be
// done, which the calling thread writes, and how much is done, which the other writes. Which chunks
// are taken is in a third one, which the calling thread touches only where it takes some itself.
struct Team::Impl {
  // A thread that comes late may read it while the next one is written: what it has read counts
  // where `pass` is the same before and after.
  struct Order {
    std::atomic<std::uint32_t> pass{0};  // 0: being written
    std::atomic<Range> range{nullptr};
    std::atomic<const void*> of{nullptr};
    std::atomic<int> items{0}, grain{1};
    std::atomic<int> first{0}, chunks{0};
  };
  struct Share {
    Job job;
    int first = 0, chunks = 0;
  };
  struct Worker {
    alignas(kCacheLine) Order order;
    // The pass, in the upper half, and how many chunks of it somebody has taken.
    alignas(kCacheLine) std::atomic<std::uint64_t> taken{0};
    // By its thread: chunks of all passes, and the last pass that it has looked at.
    alignas(kCacheLine) std::atomic<std::uint64_t> run{0};
    std::atomic<std::uint32_t> seen{0};
    // What `run` comes to, and the last pass that it was sent.
    alignas(kCacheLine) std::uint64_t expected = 0;
    std::uint32_t sent = 0;
    std::thread thread;
    bool is_present() const { return seen.load(std::memory_order_acquire) == sent; }
  };

  explicit Impl(int threads) : workers(threads - 1) {
    try {
      for (Worker& worker : workers) {
        const int number = 1 + size;
        worker.thread = std::thread([this, number, &worker] { work(number, worker); });
        ++size;
      }
    } catch (const std::system_error&) {
      // The system gives no more threads: those that there are do the work.
    }
  }

  ~Impl() {
    {
      const std::lock_guard<std::mutex> lock(mutex);
      stops = true;
    }
    wakes.notify_all();
    for (int i = 0; i < size; ++i) workers[i].thread.join();
  }

  // Once for each time that they went to sleep: it takes them a while.
  void wake() {
    if (asleep.load() == 0) return;
    {
      const std::lock_guard<std::mutex> lock(mutex);
      asleep.store(0);
      ++calls;
    }
    wakes.notify_all();
  }

  // A thread that has not come to look at its last order gets none: the system runs something else.
  void share(const Job& job) {
    if (++pass == kAsleep) pass = 1;
    present.clear();
    for (int i = 0; i < size; ++i)
      if (workers[i].is_present()) present.push_back(i);
    if (static_cast<int>(present.size()) < size) wake();
    const std::int64_t chunks = job.chunks(), shares = 1 + present.size();
    const auto first_chunk = [&](std::int64_t share) {
      return static_cast<int>(chunks * share / shares);
    };
    for (size_t i = 0; i < present.size(); ++i)
      send({job, first_chunk(i + 1), first_chunk(i + 2) - first_chunk(i + 1)}, workers[present[i]]);
    for (int chunk = 0; chunk < first_chunk(1); ++chunk) run_chunk(job, 0, chunk);
    for (int i : present) wait_for(workers[i]);
    if (failure) std::rethrow_exception(std::exchange(failure, nullptr));
  }

  void send(const Share& share, Worker& worker) {
    constexpr auto relaxed = std::memory_order_relaxed;
    Order& order = worker.order;
    order.pass.store(0, relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    order.range.store(share.job.range, relaxed);
    order.of.store(share.job.pass, relaxed);
    order.items.store(share.job.count, relaxed);
    order.grain.store(share.job.grain, relaxed);
    order.first.store(share.first, relaxed);
    order.chunks.store(share.chunks, relaxed);
    worker.expected += share.chunks;
    worker.sent = pass;
    order.pass.store(pass, std::memory_order_release);
  }

  // Whether the order was that of a pass all the while.
  bool read(const Order& order, std::uint32_t of_pass, Share& share) {
    constexpr auto relaxed = std::memory_order_relaxed;
    share.job = {order.range.load(relaxed), order.of.load(relaxed), order.items.load(relaxed),
                 order.grain.load(relaxed)};
    share.first = order.first.load(relaxed);
    share.chunks = order.chunks.load(relaxed);
    std::atomic_thread_fence(std::memory_order_acquire);
    return order.pass.load(relaxed) == of_pass;
  }

  void wait_for(Worker& worker) {
    for (int look = 1; worker.run.load(std::memory_order_acquire) != worker.expected; ++look) {
      look > kLooksBeforeYielding ? std::this_thread::yield() : pause();
      if (look == kLooksBeforeTaking) take_chunks(0, worker, pass, [&] { --worker.expected; });
    }
  }

  // Runs the chunks of a worker's share of a pass that nobody has taken, calling done() after each.
  // A pass does not end before all are taken: its share stays as it is until then.
  template <typename Done>
  void take_chunks(int by, Worker& worker, std::uint32_t of_pass, const Done& done) {
    std::uint64_t before = worker.taken.load();
    Share share;
    if (!read(worker.order, of_pass, share)) return;
    const std::uint64_t none = static_cast<std::uint64_t>(of_pass) << 32;
    const auto is_of_pass = [&] { return before >> 32 == of_pass; };
    int chunk = is_of_pass() ? static_cast<int>(before - none) : 0;
    while (chunk < share.chunks) {
      if (worker.taken.compare_exchange_strong(before, none + chunk + 1)) {
        run_chunk(share.job, by, share.first + chunk);
        done();
        before = none + ++chunk;
        continue;
      }
      if (!is_of_pass()) return;  // it has ended
      chunk = static_cast<int>(before - none);
    }
  }

  void run_chunk(const Job& job, int by, int chunk) {
    const int first = chunk * job.grain;
    try {
      job.range(job.pass, by, first, std::min(job.count, first + job.grain));
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex);
      if (!failure || chunk < failed) {
        failure = std::current_exception();
        failed = chunk;
      }
    }
  }

  void work(int number, Worker& own) {
    std::uint32_t last = 0;
    own.seen.store(last, std::memory_order_release);
    auto since = std::chrono::steady_clock::now();
    const auto next = [&] {
      const std::uint32_t now = own.order.pass.load(std::memory_order_acquire);
      return now == last ? 0 : now;
    };
    while (true) {
      for (int look = 0; look < kLooks && next() == 0; ++look) pause();
      if (next() == 0) std::this_thread::yield();
      if (const std::uint32_t now = next()) {
        take_chunks(number, own, now, [&] { own.run.fetch_add(1, std::memory_order_release); });
        last = now;
        own.seen.store(now, std::memory_order_release);
        since = std::chrono::steady_clock::now();
        continue;
      }
      if (std::chrono::steady_clock::now() - since < kPatience) continue;
      std::unique_lock<std::mutex> lock(mutex);
      const int calls_before = calls;
      own.seen.store(kAsleep, std::memory_order_release);
      ++asleep;
      wakes.wait(lock, [&] { return stops || calls != calls_before || next() != 0; });
      if (calls == calls_before) --asleep;
      if (stops) return;
      if (next() == 0) own.seen.store(last, std::memory_order_release);
      since = std::chrono::steady_clock::now();
    }
  }

  std::vector<Worker> workers;  // but the calling thread; `size` of them have a thread
  int size = 0;
  std::vector<int> present;
  std::uint32_t pass = 0;
  std::atomic<int> asleep{0};
  std::mutex mutex;
  std::condition_variable wakes;
  bool stops = false;
  int calls = 0;  // to wake
  std::exception_ptr failure;
  int failed = 0;  // the chunk that threw it
  const pid_t process = getpid();
};

Team::Team(int threads) {
  if (threads < 1 || threads > kMostThreads)
    throw std::invalid_argument("nthread is " + std::to_string(threads) +
                                "; it must be from 1 to " + std::to_string(kMostThreads));
  if (threads == 1) return;
  impl_ = std::make_unique<Impl>(threads);
  size_ = 1 + impl_->size;
}

// A process forked off has but the thread that forked it: what the others wait for stays.
Team::~Team() {
  if (impl_ && impl_->process != getpid()) static_cast<void>(impl_.release());
}

void Team::wake() {
  if (impl_) impl_->wake();
}

void Team::share_ranges(const Job& job) { impl_->share(job); }

}  // namespace dashpot
