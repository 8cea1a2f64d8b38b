// Core against the service: the vectors of `mr-damper export --vectors`, with readings that are lost, late, infinite and impossible.
// Needs no ROS.
//
// usage: core_test VECTORS.csv      prints how many lines were compared; the exit code is 1 if a bit differs

#include <cstdio>
#include <exception>

#include "allocations.hpp"
#include "vectors.hpp"

namespace mr_damper_controller {
namespace {

int fail(const char* what) {
  std::fprintf(stderr, "core_test: %s\n", what);
  return 1;
}

// One step of the exported file without the core.
template <typename Input>
void step_directly(const Vector& line, model::State& own) {
  Input input{};
  input.time_ns = line.time_ns;
  input.displacement_m = line.readings[kDisplacement];
  if constexpr (has_current_a<Input>::value) input.current_a = line.readings[kCurrent];
  if constexpr (has_force_request_n<Input>::value) input.force_request_n = line.readings[kForceRequest];
  model::Output output{};
  (void)model::step(model::default_parameters(), own, input, output);
}

// The current of a refused sample is the one that the exported file itself gives for a silence.
bool is_silent_current(const Vector& line, const model::State& own, const Values& values) {
  return !kHasInverse || line.is_accepted || is_same(values[kCurrentCommand], model::silent_current_a(own, line.time_ns));
}

int compare(const std::vector<Vector>& all) {
  Core core;
  core.reset();
  // The exported functions, called beside the core.
  model::State own{};
  Seen seen;
  double last_a = Core::without_estimate()[kCurrentCommand];
  for (std::size_t k = 0; k < all.size(); ++k) {
    const long before = allocations();
    const Values values = core.update(all[k].time_ns, all[k].readings);
    if (allocations() != before) return fail("an update allocates");
    if (kHasInverse) step_directly<model::Input>(all[k], own);
    if (!is_silent_current(all[k], own, values)) return fail("a refused sample has not the current of a silence");
    const std::string what = difference(all[k], values, seen, last_a);
    if (!what.empty()) {
      std::fprintf(stderr, "core_test: line %zu: %s differs from the service\n", k + 2, what.c_str());
      return 1;
    }
  }
  std::printf("%zu lines: %d forces, %d refused, %d stale, %d extrapolating, %d degraded, %d commands, %d of them limited\n", all.size(),
              seen.forces, seen.refused, seen.stale, seen.extrapolating, seen.degraded, seen.commands, seen.limited);
  if (seen.forces < 1000 || seen.refused < 10 || seen.valid < 1000 || seen.invalid < 10 || seen.degraded < 10) {
    return fail("the vectors have too few forces or too few disturbances for this test");
  }
  if (kHasInverse && (seen.commands < 1000 || seen.limited < 10)) return fail("the vectors have too few commands for this test");
  return 0;
}

// After reset() the first sample is like the first of a new damper.
int restart(const std::vector<Vector>& all) {
  Core used, fresh;
  for (std::size_t k = 0; k < 2000; ++k) (void)used.update(all[k].time_ns, all[k].readings);
  used.reset();
  for (std::size_t k = 0; k < 2000; ++k) {
    const Values a = used.update(all[k].time_ns, all[k].readings), b = fresh.update(all[k].time_ns, all[k].readings);
    for (std::size_t output = 0; output < kOutputCount; ++output) {
      if (!is_same(a[output], b[output])) return fail("a reset damper is not like a new one");
    }
  }
  return 0;
}

// Without displacements the current goes to the safe current (0 A), and never up; one reading more does not bring it back.
int lost_displacement(const std::vector<Vector>& all) {
  if (!kHasInverse) return 0;
  Core core;
  std::size_t k = 0;
  double before_a = 0.0;
  while (k < all.size() && before_a < 0.5) {
    const Values values = core.update(all[k].time_ns, all[k].readings);
    before_a = all[k].is_accepted ? values[kCurrentCommand] : 0.0;
    ++k;
  }
  if (k == all.size()) return fail("the vectors have no current of 0.5 A or more");
  std::int64_t time_ns = all[k - 1].time_ns;
  Readings none;
  none.fill(kNaN);
  const double first_a = before_a;
  for (int sample = 0; sample < 1000; ++sample) {
    const Values values = core.update(time_ns += 1000000, none);
    if (values[kValidity] != kIsInvalid) return fail("a lost displacement leaves a valid estimate");
    if (values[kCurrentCommand] > before_a) return fail("the current rises without displacements");
    before_a = values[kCurrentCommand];
    if (sample == 90 && before_a != first_a) return fail("the current falls before the timeout of 0.1 s");
  }
  return before_a == 0.0 ? 0 : fail("the current is not the safe one after a second without displacements");
}

int idle() {
  const Values values = Core::without_estimate();
  if (!std::isnan(values[kForce]) || values[kValidity] != 4.0 || values[kMode] != 4.0) return fail("no estimate is not marked as invalid");
  if (kHasInverse && values[kCurrentCommand] != 0.0) return fail("the safe current of the export is 0 A");
  return 0;
}

}  // namespace
}  // namespace mr_damper_controller

int main(int count, char** words) {
  using namespace mr_damper_controller;
  if (count != 2) {
    std::fprintf(stderr, "usage: core_test VECTORS.csv\n");
    return 2;
  }
  try {
    const auto all = read_vectors(words[1]);
    if (all.size() < 2000) return fail("the vectors have fewer than 2000 lines");
    const int compared = compare(all);
    return compared != 0 ? compared : restart(all) + lost_displacement(all) + idle() == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    return fail(error.what());
  }
}
