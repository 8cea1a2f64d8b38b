// Counts the calls of operator new by each thread of the whole program. A file of its own, so that the compiler does not look through
// the operators.
#include "allocations.hpp"

#include <cstdlib>
#include <new>

namespace {
thread_local long count = 0;
}  // namespace

long allocations() { return count; }

void* operator new(std::size_t size) {
  ++count;
  if (void* place = std::malloc(size)) return place;
  throw std::bad_alloc();
}
void operator delete(void* place) noexcept { std::free(place); }
void operator delete(void* place, std::size_t) noexcept { std::free(place); }
