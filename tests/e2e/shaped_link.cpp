#include "tests/e2e/shaped_link.h"

#include <fcntl.h>
#include <linux/if.h>
#include <linux/if_tun.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <vector>

#include "tests/e2e/other_program.h"

namespace anigen::test {
namespace {

using Clock = std::chrono::steady_clock;

constexpr char kDevice[] = "shaped0";
constexpr int kLargestPacket = 9000;  // few packets, so that carrying them leaves the processors alone
constexpr int kLookAround = 100;      // ms

[[noreturn]] void fail(const std::string& action) {
  throw std::runtime_error("cannot " + action + ": " + std::strerror(errno));
}

void ip(const std::string& words) {
  if (run_program("ip " + words + " 2>/dev/null") != 0) throw std::runtime_error("ip " + words + " failed");
}

/// A TUN device inside a namespace. Only the calling thread enters it, so one that ends afterwards.
int open_device(const std::string& space) {
  const int file = ::open(space.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) fail("open " + space);
  const bool inside = ::setns(file, CLONE_NEWNET) == 0;
  ::close(file);
  if (!inside) fail("enter " + space);
  const int device = ::open("/dev/net/tun", O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (device < 0) fail("open /dev/net/tun");
  ifreq request{};
  request.ifr_flags = IFF_TUN | IFF_NO_PI;
  std::strncpy(request.ifr_name, kDevice, IFNAMSIZ - 1);
  if (::ioctl(device, TUNSETIFF, &request) != 0) {
    ::close(device);
    fail("make a TUN device");
  }
  return device;
}

int open_device_in(const std::string& space) {
  int device = -1;
  std::exception_ptr problem;
  std::thread([&] {
    try {
      device = open_device(space);
    } catch (...) {
      problem = std::current_exception();
    }
  }).join();
  if (problem) std::rethrow_exception(problem);
  return device;
}

}  // namespace

struct ShapedLink::State {
  std::string name;
  Options options;
  int devices[2] = {-1, -1};
  std::atomic<bool> stop{false}, is_cut{false};
  std::atomic<std::uint64_t> carried{0};
  std::vector<std::thread> threads;

  struct Packet {
    std::vector<char> bytes;
    Clock::time_point arrives;
  };
  /// One way: what comes out of a device is put into the other one when it would arrive.
  struct Way {
    std::mutex mutex;
    std::condition_variable filled;
    std::deque<Packet> packets;
    Clock::time_point wire_is_free = Clock::now();
  };
  Way ways[2];

  ~State() {
    stop = true;
    for (std::thread& thread : threads) thread.join();
    for (int i = 0; i < 2; ++i) {
      if (devices[i] >= 0) ::close(devices[i]);
      run_program("ip netns del " + name + "-" + std::to_string(i) + " 2>/dev/null");
    }
  }

  void take(int from) {
    Way& way = ways[from];
    pollfd waiting{devices[from], POLLIN, 0};
    while (!stop) {
      if (::poll(&waiting, 1, kLookAround) <= 0) continue;
      Packet packet;
      packet.bytes.resize(kLargestPacket);
      const ssize_t size = ::read(devices[from], packet.bytes.data(), packet.bytes.size());
      if (size <= 0 || is_cut) continue;
      packet.bytes.resize(static_cast<std::size_t>(size));
      const Clock::time_point now = Clock::now();
      const std::lock_guard<std::mutex> lock(way.mutex);
      const auto seconds = [](double s) {
        return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
      };
      if (way.wire_is_free > now + seconds(options.queue_seconds)) continue;
      way.wire_is_free =
          std::max(way.wire_is_free, now) + seconds(8.0 * static_cast<double>(size) / options.bits_per_second);
      packet.arrives = way.wire_is_free + options.delay;
      way.packets.push_back(std::move(packet));
      way.filled.notify_one();
    }
  }

  void deliver(int from) {
    Way& way = ways[from];
    std::unique_lock<std::mutex> lock(way.mutex);
    while (!stop) {
      if (way.packets.empty()) {
        way.filled.wait_for(lock, std::chrono::milliseconds(kLookAround));
        continue;
      }
      const Packet packet = std::move(way.packets.front());
      way.packets.pop_front();
      lock.unlock();
      std::this_thread::sleep_until(packet.arrives);
      if (!is_cut && ::write(devices[1 - from], packet.bytes.data(), packet.bytes.size()) > 0)
        carried += packet.bytes.size();
      lock.lock();
    }
  }
};

ShapedLink::ShapedLink(const std::string& name, const Options& options) : state_(std::make_unique<State>()) {
  State& state = *state_;
  state.name = name;
  state.options = options;
  for (int i = 0; i < 2; ++i) {
    const std::string space = name + "-" + std::to_string(i);
    ip("netns add " + space);
    state.devices[i] = open_device_in(host(i));
    ip("-n " + space + " link set lo up");
    ip("-n " + space + " link set dev " + kDevice + " mtu " + std::to_string(kLargestPacket) + " up");
    ip("-n " + space + " addr add " + address(i) + " peer " + address(1 - i) + " dev " + kDevice);
  }
  for (int i = 0; i < 2; ++i) {
    state.threads.emplace_back([&state, i] { state.take(i); });
    state.threads.emplace_back([&state, i] { state.deliver(i); });
  }
}

ShapedLink::~ShapedLink() = default;

void ShapedLink::cut(bool is_cut) { state_->is_cut = is_cut; }

std::string ShapedLink::host(int number) const { return "/run/netns/" + state_->name + "-" + std::to_string(number); }

double ShapedLink::bytes_carried() const { return static_cast<double>(state_->carried); }

}  // namespace anigen::test
