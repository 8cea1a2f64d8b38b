// The plugin as the controller manager uses it: loaded by pluginlib, configured by parameters, given interfaces, activated, updated. Its
// exported state interfaces and its command must have the service's bits (the vectors of `mr-damper export --vectors`).
//
// usage: plugin_test VECTORS.csv controllers.yaml      prints what was checked; the exit code is 1 if something differs

#include <cstdio>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <stdexcept>
#include <thread>

#include "allocations.hpp"
#include "controller_interface/chainable_controller_interface.hpp"
#include "hardware_interface/loaned_command_interface.hpp"
#include "hardware_interface/loaned_state_interface.hpp"
#include "pluginlib/class_loader.hpp"
#include "rclcpp/rclcpp.hpp"
#include "vectors.hpp"

namespace mr_damper_controller {
namespace {

using controller_interface::ChainableControllerInterface;
using controller_interface::return_type;
using hardware_interface::CommandInterface;
using hardware_interface::LoanedCommandInterface;
using hardware_interface::LoanedStateInterface;
using hardware_interface::StateInterface;
using lifecycle_msgs::msg::State;

void check(bool holds, const std::string& what) {
  if (!holds) throw std::runtime_error(what);
}

constexpr const char* kCommand = "front_left/current_command";

// A controller with everything that a controller manager gives it.
class Rig {
 public:
  Rig(pluginlib::ClassLoader<ChainableControllerInterface>& loader, const std::string& name, std::vector<rclcpp::Parameter> parameters,
      const std::vector<std::string>& arguments = {})
      : controller_(loader.createSharedInstance("mr_damper_controller/MrDamperController")) {
    controller_interface::ControllerInterfaceParams init;
    init.controller_name = name;
    init.update_rate = 1000;
    init.controller_manager_update_rate = 1000;
    init.node_options = controller_->define_custom_node_options().parameter_overrides(parameters).arguments(arguments);
    check(controller_->init(init) == return_type::OK, "the controller does not initialise");
  }

  bool configure() {
    if (controller_->configure().id() != State::PRIMARY_STATE_INACTIVE) return false;
    for (const auto& state : controller_->export_state_interfaces()) outputs_[state->get_interface_name()] = state;
    for (const auto& reference : controller_->export_reference_interfaces()) references_[reference->get_interface_name()] = reference;
    for (const auto& wanted : controller_->state_interface_configuration().names) {
      states_[wanted] = std::make_shared<StateInterface>("front_left", wanted.substr(wanted.find('/') + 1));
    }
    return true;
  }

  bool activate(bool is_chained) {
    check(controller_->set_chained_mode(is_chained), "the chained mode cannot be set");
    std::vector<LoanedStateInterface> loaned;
    for (const auto& wanted : controller_->state_interface_configuration().names) {
      loaned.emplace_back(std::const_pointer_cast<const StateInterface>(states_.at(wanted)), nullptr);
    }
    std::vector<LoanedCommandInterface> commands;
    for (const auto& wanted : controller_->command_interface_configuration().names) {
      check(wanted == kCommand, "another command interface is claimed: " + wanted);
      commands.emplace_back(command_, nullptr);
    }
    controller_->assign_interfaces(std::move(commands), std::move(loaned));
    return controller_->get_node()->activate().id() == State::PRIMARY_STATE_ACTIVE;
  }

  void deactivate() {
    check(controller_->get_node()->deactivate().id() == State::PRIMARY_STATE_INACTIVE, "the controller cannot be deactivated");
    controller_->release_interfaces();
  }

  // One update; returns the values of the exported state interfaces.
  Values update(const Vector& line) {
    write(line);
    const rclcpp::Time time(line.time_ns, RCL_STEADY_TIME);
    const long before = allocations();
    const auto result = controller_->update(time, period_);
    const long after = allocations();
    check(after == before, "an update allocates");
    check(result == return_type::OK, "an update fails");
    return values();
  }

  // One update while another thread reads an exported state interface.
  return_type update_while_busy(const std::string& name, const Vector& line) {
    write(line);
    std::promise<void> held, done;
    std::thread reader([&] {
      const std::shared_lock<std::shared_mutex> lock(outputs_.at(name)->get_mutex());
      held.set_value();
      done.get_future().wait();
    });
    held.get_future().wait();
    const auto result = controller_->update(rclcpp::Time(line.time_ns, RCL_STEADY_TIME), period_);
    done.set_value();
    reader.join();
    return result;
  }

  void write(const Vector& line) {
    for (std::size_t input = 0; input < kInputCount; ++input) {
      if (!kInputs[input].exists) continue;
      const auto state = states_.find(std::string("front_left/") + kInputs[input].name);
      if (state != states_.end()) {
        check(state->second->set_value(line.readings[input]), "a state interface is busy");
      } else if (!std::isnan(line.readings[input])) {
        // A preceding controller writes only what it has.
        check(references_.at(kInputs[input].name)->set_value(line.readings[input]), "a reference interface is busy");
      }
    }
  }

  Values values() const {
    Values all;
    all.fill(kNaN);
    for (std::size_t output = 0; output < kOutputCount; ++output) {
      if (kOutputs[output].exists) all[output] = outputs_.at(kOutputs[output].name)->get_optional<double>().value();
    }
    return all;
  }

  double command() const { return command_->get_optional<double>().value(); }
  const std::shared_ptr<ChainableControllerInterface>& controller() const { return controller_; }
  std::size_t reference_count() const { return references_.size(); }

 private:
  std::shared_ptr<ChainableControllerInterface> controller_;
  std::map<std::string, StateInterface::ConstSharedPtr> outputs_;
  std::map<std::string, StateInterface::SharedPtr> states_;
  std::map<std::string, CommandInterface::SharedPtr> references_;
  CommandInterface::SharedPtr command_ = std::make_shared<CommandInterface>("front_left", "current_command");
  const rclcpp::Duration period_{0, 1000000};
};

// Parameters that take all inputs but the demanded force from state interfaces, or none.
std::vector<rclcpp::Parameter> parameters(bool is_from_state) {
  std::vector<rclcpp::Parameter> all;
  for (std::size_t input = 0; input < kInputCount; ++input) {
    if (kInputs[input].exists && is_from_state && input != kForceRequest) {
      all.emplace_back(std::string(kInputs[input].name) + ".state_interface", std::string("front_left/") + kInputs[input].name);
    }
  }
  if (kHasInverse) all.emplace_back("current_command.command_interface", kCommand);
  return all;
}

using Loader = pluginlib::ClassLoader<ChainableControllerInterface>;

void compare(Loader& loader, const std::vector<Vector>& all, bool is_from_state) {
  Rig rig(loader, is_from_state ? "from_state" : "from_references", parameters(is_from_state));
  check(rig.configure(), "the controller does not configure");
  check(rig.values()[kValidity] == 4.0 && std::isnan(rig.values()[kForce]), "an inactive controller has an estimate");
  // Twice, because an activation must begin with a damper at rest.
  for (int run = 0; run < 2; ++run) {
    check(rig.activate(kHasInverse || !is_from_state), "the controller does not activate");
    Seen seen;
    double last_a = 0.0;
    for (std::size_t k = 0; k < all.size(); ++k) {
      const Values values = rig.update(all[k]);
      const std::string what = difference(all[k], values, seen, last_a);
      check(what.empty(), "line " + std::to_string(k + 2) + ": " + what + " differs from the service");
      check(!kHasInverse || is_same(rig.command(), values[kCurrentCommand]), "the command interface has another current");
    }
    check(seen.forces > 1000 && seen.refused > 10, "the vectors have too few forces or refused displacements");
    std::printf("%s: %zu lines, %d forces, %d refused, %d commands\n", is_from_state ? "state interfaces" : "reference interfaces",
                all.size(), seen.forces, seen.refused, seen.commands);
    rig.deactivate();
    check(rig.values()[kValidity] == 4.0 && std::isnan(rig.values()[kForce]), "a deactivated controller has an estimate");
    check(!kHasInverse || rig.command() == 0.0, "a deactivated controller does not leave the safe current");
  }
}

// The same forces from an interface that is positive in compression.
void direction(Loader& loader, const std::vector<Vector>& all) {
  auto wanted = parameters(true);
  wanted.emplace_back("displacement.sign", -1);
  Rig rig(loader, "reversed", wanted);
  check(rig.configure() && rig.activate(kHasInverse), "the reversed controller does not activate");
  Seen seen;
  double last_a = 0.0;
  for (std::size_t k = 0; k < 3000; ++k) {
    Vector line = all[k];
    line.readings[kDisplacement] = -line.readings[kDisplacement];
    const std::string what = difference(line, rig.update(line), seen, last_a);
    check(what.empty(), "reversed, line " + std::to_string(k + 2) + ": " + what);
  }
  rig.deactivate();
}

// While another thread holds a state interface, its value stays, and the estimate is marked as invalid.
void busy_interfaces(Loader& loader, const std::vector<Vector>& all) {
  Rig rig(loader, "busy", parameters(true));
  check(rig.configure() && rig.activate(kHasInverse), "the controller does not activate");
  std::size_t k = 0;
  while (rig.update(all[k])[kValidity] == kIsInvalid) ++k;
  check(rig.update_while_busy("force", all[++k]) == return_type::OK, "an update fails because a force is read");
  check(rig.values()[kValidity] == kIsInvalid, "an old force is marked as a new one");
  check(rig.update_while_busy("validity", all[++k]) == return_type::ERROR, "an update that cannot mark its estimate succeeds");
  check(rig.update(all[++k])[kValidity] != kIsInvalid, "the estimate does not come back");
  rig.deactivate();
}

// A reference that is written once counts once: afterwards the input is missing.
void references_count_once(Loader& loader, const std::vector<Vector>& all) {
  Rig rig(loader, "once", parameters(false));
  check(rig.configure() && rig.reference_count() >= 2, "the inputs are not exported as references");
  check(!rig.activate(false), "the controller activates although nobody writes its references");
  Rig chained(loader, "once_chained", parameters(false));
  check(chained.configure() && chained.activate(true), "the controller does not activate when chained");
  std::size_t k = 0;
  while (!(chained.update(all[k]), chained.values()[kValidity] < 4.0)) ++k;
  Vector silent = all[k];
  silent.readings.fill(kNaN);
  silent.time_ns += 1000000;
  check(chained.update(silent)[kValidity] == 4.0, "a preceding controller that stops leaves a valid estimate");
  chained.deactivate();
}

// The example configures a model with displacement and current.
void example(Loader& loader, const std::string& file) {
  Rig rig(loader, "front_left_damper", {}, {"--ros-args", "--params-file", file});
  check(rig.configure(), "the example does not configure");
  const auto names = rig.controller()->state_interface_configuration().names;
  check(names == std::vector<std::string>{"front_left/position", "front_left/current"}, "the example names other interfaces");
}

void bad_parameters(Loader& loader) {
  const auto refuses = [&](const char* node, std::vector<rclcpp::Parameter> parameters) {
    Rig rig(loader, node, std::move(parameters));
    return !rig.configure();
  };
  check(refuses("bad_name", {{"displacement.state_interface", "position"}}), "a name without a slash is taken");
  check(refuses("bad_offset", {{"displacement.offset_m", kNaN}}), "an offset that is NaN is taken");
  if (kInputs[kCurrent].exists) {
    check(refuses("twice", {{"displacement.state_interface", "a/b"}, {"current.state_interface", "a/b"}}),
          "one interface serves two inputs");
  }
  if (kHasInverse) {
    check(refuses("bad_command", {{"current_command.command_interface", "/x"}}), "a command interface without a joint is taken");
  }
  bool is_thrown = false;
  try {
    Rig rig(loader, "bad_sign", {{"displacement.sign", 0}});
  } catch (const std::exception&) {
    is_thrown = true;
  }
  check(is_thrown, "a sign of 0 is taken");
}

}  // namespace
}  // namespace mr_damper_controller

int main(int count, char** words) {
  using namespace mr_damper_controller;
  if (count != 3) {
    std::fprintf(stderr, "usage: plugin_test VECTORS.csv controllers.yaml\n");
    return 2;
  }
  rclcpp::init(0, nullptr);
  int code = 0;
  try {
    const auto all = read_vectors(words[1]);
    check(all.size() >= 3000, "the vectors have fewer than 3000 lines");
    Loader loader("controller_interface", "controller_interface::ChainableControllerInterface");
    compare(loader, all, true);
    compare(loader, all, false);
    direction(loader, all);
    busy_interfaces(loader, all);
    references_count_once(loader, all);
    if (kInputs[kCurrent].exists && !kInputs[kVelocity].exists) example(loader, words[2]);
    bad_parameters(loader);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "plugin_test: %s\n", error.what());
    code = 1;
  }
  rclcpp::shutdown();
  return code;
}
