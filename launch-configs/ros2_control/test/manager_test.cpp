// The controller in a real controller manager, between two others, over a real resource manager:
//
//   hardware front_left ──position, current──→ front_left_damper ──force, validity, ...──→ observer
//   demand ──force_request──→ front_left_damper ──current──→ hardware front_left
//
// What the observer reads and what the hardware gets must have the service's bits (the vectors of `mr-damper export --vectors`).
// For models with displacement and current as inputs.
//
// usage: manager_test VECTORS.csv controllers.yaml      prints what was checked; the exit code is 1 if something differs, and 77
// if the model has other inputs

#include <atomic>
#include <chrono>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <thread>

#include "controller_interface/controller_interface.hpp"
#include "controller_manager/controller_manager.hpp"
#include "hardware_interface/resource_manager.hpp"
#include "hardware_interface/system_interface.hpp"
#include "rcl/time.h"
#include "rclcpp/rclcpp.hpp"
#include "vectors.hpp"

namespace mr_damper_controller {
namespace {

using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;

constexpr const char* kName = "front_left_damper";
// The times of the vectors begin near zero and are set back at places. The controller manager takes no time of zero.
constexpr std::int64_t kStartNs = 1000000000000;

// What passes between the test and its hardware and controllers. One thread at a time uses it.
struct World {
  Readings readings{};
  double written_a = kNaN;
  Values seen{};
};

class Hardware : public hardware_interface::SystemInterface {
 public:
  explicit Hardware(World& world) : world_(world) {}

  hardware_interface::return_type read(const rclcpp::Time&, const rclcpp::Duration&) override {
    set_state("front_left/position", world_.readings[kDisplacement]);
    set_state("front_left/current", world_.readings[kCurrent]);
    return hardware_interface::return_type::OK;
  }

  hardware_interface::return_type write(const rclcpp::Time&, const rclcpp::Duration&) override {
    world_.written_a = get_command<double>("front_left/current");
    return hardware_interface::return_type::OK;
  }

 private:
  World& world_;
};

// A controller of the test: claims interfaces of the damper.
class Neighbour : public controller_interface::ControllerInterface {
 public:
  explicit Neighbour(World& world) : world_(world) {}
  CallbackReturn on_init() override { return CallbackReturn::SUCCESS; }
  CallbackReturn on_configure(const rclcpp_lifecycle::State&) override { return CallbackReturn::SUCCESS; }
  CallbackReturn on_activate(const rclcpp_lifecycle::State&) override { return CallbackReturn::SUCCESS; }
  CallbackReturn on_deactivate(const rclcpp_lifecycle::State&) override { return CallbackReturn::SUCCESS; }
  InterfaceConfiguration command_interface_configuration() const override { return {interface_configuration_type::NONE, {}}; }
  InterfaceConfiguration state_interface_configuration() const override { return {interface_configuration_type::NONE, {}}; }

 protected:
  World& world_;
};

class Demand : public Neighbour {
 public:
  using Neighbour::Neighbour;
  InterfaceConfiguration command_interface_configuration() const override {
    return {interface_configuration_type::INDIVIDUAL, {std::string(kName) + "/force_request"}};
  }
  return_type update(const rclcpp::Time&, const rclcpp::Duration&) override {
    return command_interfaces_[0].set_value(world_.readings[kForceRequest]) ? return_type::OK : return_type::ERROR;
  }
};

class Observer : public Neighbour {
 public:
  using Neighbour::Neighbour;
  InterfaceConfiguration state_interface_configuration() const override {
    InterfaceConfiguration configuration{interface_configuration_type::INDIVIDUAL, {}};
    for (const Channel& output : kOutputs) {
      if (output.exists) configuration.names.push_back(std::string(kName) + "/" + output.name);
    }
    return configuration;
  }
  return_type update(const rclcpp::Time&, const rclcpp::Duration&) override {
    world_.seen.fill(kNaN);
    std::size_t place = 0;
    for (std::size_t output = 0; output < kOutputCount; ++output) {
      if (kOutputs[output].exists) world_.seen[output] = state_interfaces_[place++].get_optional<double>().value_or(-1.0);
    }
    return return_type::OK;
  }
};

void check(bool holds, const std::string& what) {
  if (!holds) throw std::runtime_error(what);
}

hardware_interface::HardwareComponentParams description() {
  hardware_interface::HardwareComponentParams params;
  auto& info = params.hardware_info;
  info.name = "front_left_hardware";
  info.type = "system";
  info.rw_rate = 0;
  info.is_async = false;
  hardware_interface::ComponentInfo joint;
  joint.name = "front_left";
  joint.type = "joint";
  for (const char* name : {"position", "current"}) {
    hardware_interface::InterfaceInfo state;
    state.name = name;
    state.data_type = "double";
    state.size = 1;
    joint.state_interfaces.push_back(state);
    if (std::string(name) == "current") joint.command_interfaces.push_back(state);
  }
  info.joints.push_back(joint);
  return params;
}

// Its components do not come from a robot description.
class Resources : public hardware_interface::ResourceManager {
 public:
  using hardware_interface::ResourceManager::ResourceManager;
  void components_are_complete() { components_are_loaded_and_initialized_ = true; }
};

class Manager {
 public:
  Manager(World& world, const std::string& file) : world_(world), clock_(std::make_shared<rclcpp::Clock>(RCL_STEADY_TIME)) {
    auto resources = std::make_unique<Resources>(clock_, rclcpp::get_logger("resources"));
    auto hardware = description();
    hardware.clock = clock_;
    hardware.executor = executor_;
    resources->import_component(std::make_unique<Hardware>(world), hardware);
    resources->components_are_complete();
    rclcpp_lifecycle::State active(lifecycle_msgs::msg::State::PRIMARY_STATE_ACTIVE, "active");
    check(resources->set_component_state("front_left_hardware", active) == hardware_interface::return_type::OK, "the hardware stays off");
    auto options = controller_manager::get_cm_node_options();
    options.arguments({"--ros-args", "--params-file", file});
    manager_ = std::make_unique<controller_manager::ControllerManager>(std::move(resources), executor_, "controller_manager", "", options);
    check(rcl_enable_ros_time_override(manager_->get_clock()->get_clock_handle()) == RCL_RET_OK, "the clock cannot be taken over");
    manager_->set_parameter(rclcpp::Parameter(std::string(kName) + ".params_file", std::vector<std::string>{file}));
  }

  // Loads the damper by its plugin, and its neighbours; activates all.
  void start() {
    auto damper = manager_->load_controller(kName);
    check(damper != nullptr, "the controller manager does not load the controller");
    if (kHasInverse) {
      damper->get_node()->set_parameter(rclcpp::Parameter("current_command.command_interface", "front_left/current"));
      names_.emplace_back("demand");
      check(manager_->add_controller(std::make_shared<Demand>(world_), "demand", "Demand") != nullptr, "no controller demand");
    }
    names_.emplace_back(kName);
    names_.emplace_back("observer");
    check(manager_->add_controller(std::make_shared<Observer>(world_), "observer", "Observer") != nullptr, "no controller observer");
    for (const char* name : {kName, "observer", "demand"}) {
      if (kHasInverse || std::string(name) != "demand") {
        check(manager_->configure_controller(name) == return_type::OK, std::string("not configured: ") + name);
      }
    }
    world_.readings.fill(kNaN);
    check(switched(names_, {}), "the controllers do not become active");
  }

  void stop() {
    world_.readings.fill(kNaN);
    check(switched({}, names_), "the controllers do not become inactive");
  }

  // Controllers get the time of the manager's clock, which stands at `time_ns` as in a simulation.
  void cycle(std::int64_t time_ns) {
    check(rcl_set_ros_time_override(manager_->get_clock()->get_clock_handle(), time_ns) == RCL_RET_OK, "the clock cannot be set");
    const rclcpp::Time time(time_ns, manager_->get_trigger_clock()->get_clock_type());
    const rclcpp::Duration period(0, 1000000);
    manager_->read(time, period);
    check(manager_->update(time, period) == return_type::OK, "the controller manager's update fails");
    manager_->write(time, period);
  }

 private:
  // Switching waits for updates, which another thread makes meanwhile.
  bool switched(const std::vector<std::string>& on, const std::vector<std::string>& off) {
    std::atomic<bool> is_done{false};
    std::thread updates([&] {
      for (std::int64_t time_ns = kStartNs / 2; !is_done; time_ns += 1000000) {
        cycle(time_ns);
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
    const auto result = manager_->switch_controller(on, off, controller_manager_msgs::srv::SwitchController::Request::STRICT, true,
                                                    rclcpp::Duration(5, 0));
    is_done = true;
    updates.join();
    return result == return_type::OK;
  }

  World& world_;
  rclcpp::Clock::SharedPtr clock_;
  std::shared_ptr<rclcpp::Executor> executor_ = std::make_shared<rclcpp::executors::SingleThreadedExecutor>();
  std::unique_ptr<controller_manager::ControllerManager> manager_;
  std::vector<std::string> names_;
};

void compare(const std::vector<Vector>& all, const std::string& file) {
  World world;
  Manager manager(world, file);
  manager.start();
  Seen seen;
  double last_a = 0.0;
  for (std::size_t k = 0; k < all.size(); ++k) {
    world.readings = all[k].readings;
    manager.cycle(kStartNs + all[k].time_ns);
    // The cycles of the switch had no displacement, which the first estimate reports.
    if (k == 0) continue;
    const std::string what = difference(all[k], world.seen, seen, last_a);
    check(what.empty(), "line " + std::to_string(k + 2) + ": " + what + " differs from the service");
    check(!kHasInverse || is_same(world.written_a, world.seen[kCurrentCommand]), "the hardware gets another current");
  }
  check(seen.forces > 1000 && seen.refused > 10 && (!kHasInverse || seen.commands > 1000), "the vectors have too few forces or commands");
  std::printf("controller manager: %zu lines, %d forces, %d refused, %d commands\n", all.size(), seen.forces, seen.refused, seen.commands);
  manager.stop();
  check(!kHasInverse || world.written_a == 0.0, "a deactivated controller does not leave the safe current");
}

}  // namespace
}  // namespace mr_damper_controller

int main(int count, char** words) {
  using namespace mr_damper_controller;
  if (count != 3) {
    std::fprintf(stderr, "usage: manager_test VECTORS.csv controllers.yaml\n");
    return 2;
  }
  if (!kInputs[kCurrent].exists || kInputs[kVelocity].exists || kInputs[kCaseTemperature].exists) {
    std::printf("NOT RUN: the model has other inputs than displacement and current\n");
    return 77;
  }
  rclcpp::init(0, nullptr);
  int code = 0;
  try {
    compare(read_vectors(words[1]), words[2]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "manager_test: %s\n", error.what());
    code = 1;
  }
  rclcpp::shutdown();
  return code;
}
