#include "dashpot/threads/team.hpp"

#include <unistd.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "dashpot/lanes/aligned.hpp"

namespace dashpot {

namespace {

// How long a thread waits for a pass before it sleeps: longer than what a step does between two
// passes, and than a script does between two steps.
constexpr std::chrono::microseconds kPatience{500};
constexpr int kLooks = 64;  // between two looks at the clock
// How long the calling thread waits for others to take what is theirs, in looks: some microseconds,
// after which to move it into other caches is the lesser evil.
constexpr int kLooksBeforeTaking = 150;
// And for what they began, before others may have the processor: a stopped thread may wait for it.
constexpr int kLooksBeforeYielding = 5000;
// In place of the number of a pass that a thread has seen.
constexpr std::uint32_t kAsleep = 0xffffffffu;

// How the processor rounds, and what it does with subnormal numbers: a thread's own.
#if defined(__x86_64__)
void relax() { __builtin_ia32_pause(); }
unsigned rounding() { return _mm_getcsr(); }
void set_rounding(unsigned mode) { _mm_setcsr(mode); }
#elif defined(__aarch64__)
// Some 10 ns, as many as the pause of x86-64; YIELD does nothing on nearly all processors.
void relax() { asm volatile("isb" : : : "memory"); }
unsigned rounding() {
  std::uint64_t mode;
  asm volatile("mrs %0, fpcr" : "=r"(mode));
  return static_cast<unsigned>(mode);  // the upper half is reserved, and zero
}
void set_rounding(unsigned mode) {
  asm volatile("msr fpcr, %0" : : "r"(static_cast<std::uint64_t>(mode)));
}
#else
void relax() {}
unsigned rounding() { return 0; }
void set_rounding(unsigned) {}
#endif

}  // namespace

// A pass costs little more than two cache lines that go from one thread to the other: what is to be
// done, which the calling thread writes, and how much is done, which the other writes. Which chunks
// are taken is in a third one, which the calling thread touches only where it takes some itself.
struct Team::Impl {
  // What a thread is to do. Written once it has read the one before, as `seen` says or what it ran.
  struct Order {
    Job job;
    int first = 0, chunks = 0;
    unsigned rounding = 0;
    std::atomic<std::uint32_t> pass{0};
  };
  struct Worker {
    alignas(kCacheLine) Order order;
    // The pass, in the upper half, and how many chunks of it somebody has taken.
    alignas(kCacheLine) std::atomic<std::uint64_t> taken{0};
    // By its thread: chunks of all passes, and the last pass that it is done with.
    alignas(kCacheLine) std::atomic<std::uint64_t> run{0};
    std::atomic<std::uint32_t> seen{0};
    // What `run` comes to; the last passes that it was sent, and has run chunks of.
    alignas(kCacheLine) std::uint64_t expected = 0;
    std::uint32_t sent = 0, took_part = 0;
    std::thread thread;
    bool is_present() const {
      const std::uint32_t last = seen.load(std::memory_order_acquire);
      return last != kAsleep && (last == sent || took_part == sent);
    }
  };

  explicit Impl(int threads) : workers(threads - 1) {
    try {
      for (Worker& worker : workers) {
        const int number = 1 + size;
        worker.thread = std::thread([this, number, &worker] { work(number, worker); });
        ++size;
      }
    } catch (const std::exception&) {
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

  bool is_forked_off() const { return process != getpid(); }

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

  // A thread that has not come to its last order gets none: the system runs something else.
  void share(const Job& job) {
    if (++pass == kAsleep) pass = 1;
    present.clear();
    for (int i = 0; i < size; ++i)
      if (workers[i].is_present()) present.push_back(i);
    if (static_cast<int>(present.size()) < size) wake();
    const std::int64_t chunks = job.chunks(), shares = 1 + present.size();
    // Where there are fewer chunks than threads, the first ones have them.
    const auto first_chunk = [&](std::int64_t share) {
      return static_cast<int>((chunks * share + shares - 1) / shares);
    };
    for (size_t i = 0; i < present.size(); ++i)
      if (const int first = first_chunk(i + 1), end = first_chunk(i + 2); first < end)
        send(job, first, end - first, workers[present[i]]);
    for (int chunk = 0; chunk < first_chunk(1); ++chunk) run_chunk(job, 0, chunk);
    for (int i : present) wait_for(workers[i]);
    if (failure) std::rethrow_exception(std::exchange(failure, nullptr));
  }

  void send(const Job& job, int first, int chunks, Worker& worker) {
    Order& order = worker.order;
    order.job = job;
    order.first = first;
    order.chunks = chunks;
    order.rounding = rounding();
    worker.expected += chunks;
    worker.sent = pass;
    order.pass.store(pass, std::memory_order_release);
  }

  void wait_for(Worker& worker) {
    int left = worker.order.chunks;  // by the calling thread
    for (int look = 1; worker.run.load(std::memory_order_acquire) != worker.expected; ++look) {
      look > kLooksBeforeYielding ? std::this_thread::yield() : relax();
      if (look == kLooksBeforeTaking)
        take_chunks(0, worker, pass, worker.order.job, worker.order.first, worker.order.chunks,
                    [&] {
                      --worker.expected;
                      --left;
                    });
    }
    if (left > 0) worker.took_part = worker.sent;
  }

  // Runs the chunks of a worker's share of a pass that nobody has taken, calling done() after each.
  // The next order comes when the worker has run one of them, or is done with the pass: up to then
  // `taken` is of this pass or of one before.
  template <typename Done>
  void take_chunks(int by, Worker& worker, std::uint32_t of_pass, const Job& job, int first,
                   int chunks, const Done& done) {
    const std::uint64_t none = static_cast<std::uint64_t>(of_pass) << 32;
    std::uint64_t before = worker.taken.load();
    const auto is_of_pass = [&] { return before >> 32 == of_pass; };
    int chunk = is_of_pass() ? static_cast<int>(before - none) : 0;
    while (chunk < chunks) {
      if (worker.taken.compare_exchange_strong(before, none + chunk + 1)) {
        run_chunk(job, by, first + chunk);
        done();
        before = none + ++chunk;
      } else if (is_of_pass()) {
        chunk = static_cast<int>(before - none);
      } else {
        return;  // it has ended, and others since
      }
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
    auto since = std::chrono::steady_clock::now();
    const auto is_sent = [&] { return own.order.pass.load(std::memory_order_acquire) != last; };
    while (true) {
      for (int look = 0; look < kLooks && !is_sent(); ++look) relax();
      if (!is_sent()) std::this_thread::yield();
      if (is_sent()) {
        last = own.order.pass.load(std::memory_order_acquire);
        const Job job = own.order.job;
        const int first = own.order.first, chunks = own.order.chunks;
        if (rounding() != own.order.rounding) set_rounding(own.order.rounding);
        take_chunks(number, own, last, job, first, chunks,
                    [&] { own.run.fetch_add(1, std::memory_order_release); });
        own.seen.store(last, std::memory_order_release);
        since = std::chrono::steady_clock::now();
        continue;
      }
      if (std::chrono::steady_clock::now() - since < kPatience) continue;
      std::unique_lock<std::mutex> lock(mutex);
      const int calls_before = calls;
      own.seen.store(kAsleep, std::memory_order_release);
      ++asleep;
      wakes.wait(lock, [&] { return stops || calls != calls_before || is_sent(); });
      if (calls == calls_before) --asleep;
      if (stops) return;
      if (!is_sent()) own.seen.store(last, std::memory_order_release);
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
  if (impl_ && impl_->is_forked_off()) static_cast<void>(impl_.release());
}

void Team::begin(bool shares) {
  shares_ = shares && impl_ && !impl_->is_forked_off();
  if (shares_) impl_->wake();
}

void Team::share_ranges(const Job& job) { impl_->share(job); }

}  // namespace dashpot
