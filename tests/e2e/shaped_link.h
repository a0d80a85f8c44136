#pragma once
#include <chrono>
#include <memory>
#include <string>

namespace anigen::test {

/// Two network namespaces of this machine, as two hosts that are joined by a link of a given rate and delay. The link
/// is a pair of TUN devices between which this process carries the packets, since a kernel need not have netem.
/// Everything is removed at the end. Needs root, /dev/net/tun and iproute2's `ip`.
class ShapedLink {
 public:
  struct Options {
    double bits_per_second = 1e9;
    std::chrono::microseconds delay{10000};  ///< one way
    double queue_seconds = 0.1;              ///< of packets at the full rate; more are dropped
  };

  /// @param name of the namespaces `<name>-0` and `<name>-1`, whose addresses are 10.77.0.1 and 10.77.0.2
  /// @throws std::runtime_error when this machine does not let us
  ShapedLink(const std::string& name, const Options& options);
  ~ShapedLink();
  ShapedLink(const ShapedLink&) = delete;
  ShapedLink& operator=(const ShapedLink&) = delete;

  /// A cut link loses all packets, also those on their way.
  void cut(bool is_cut);
  /// Path of the namespace of a host, 0 or 1, for setns().
  std::string host(int number) const;
  static std::string address(int host) { return "10.77.0." + std::to_string(host + 1); }
  double bytes_carried() const;  ///< both ways

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace anigen::test
