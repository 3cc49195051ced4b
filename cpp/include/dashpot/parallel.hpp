// Independent items of work on threads.

#pragma once

#include <functional>

namespace dashpot {

// Number of threads to use for `items` items: `requested`, or the machine's when 0; never more
// than there are items. Throws std::invalid_argument where requested < 0.
int thread_count(int requested, int items);

// Calls task(worker, item) for every item in [0, items), items handed out in order to `threads`
// workers (0 <= worker < threads), or fewer where the system gives no more threads; with one thread
// everything runs on the calling thread. What a task writes must depend on its item alone, so that
// results do not depend on the thread count. Where tasks throw, the exception of the lowest item is
// rethrown after all threads have stopped.
void parallel_for(int items, int threads, const std::function<void(int worker, int item)>& task);

}  // namespace dashpot
