#include "anigen/train/distributed/gloo_devices.h"

#if ANIGEN_HAS_C10D
#include <arpa/inet.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <sstream>

#include "anigen/core/error.h"
#include "anigen/core/process_identity.h"

namespace anigen::train {
namespace {

// The address of this machine on the way to a host; "" when there is no way. Debian gives a machine's own name the
// address 127.0.1.1, which Gloo would tell the other machines. Connecting a datagram socket sends nothing.
std::string address_towards(const std::string& host, int port) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found) != 0) return "";
  std::string address;
  for (const addrinfo* each = found; each != nullptr && address.empty(); each = each->ai_next) {
    const int socket = ::socket(each->ai_family, SOCK_DGRAM, 0);
    if (socket < 0) continue;
    sockaddr_storage own{};
    socklen_t size = sizeof own;
    char text[NI_MAXHOST];
    if (::connect(socket, each->ai_addr, each->ai_addrlen) == 0 &&
        ::getsockname(socket, reinterpret_cast<sockaddr*>(&own), &size) == 0 &&
        ::getnameinfo(reinterpret_cast<sockaddr*>(&own), size, text, sizeof text, nullptr, 0, NI_NUMERICHOST) == 0) {
      address = text;
    }
    ::close(socket);
  }
  ::freeaddrinfo(found);
  return address.rfind("127.", 0) == 0 ? "" : address;
}

}  // namespace

GlooDevices find_gloo_devices(const Rendezvous& rendezvous, bool local) {
  GlooDevices found;
  if (const char* interfaces = std::getenv("GLOO_SOCKET_IFNAME"); interfaces != nullptr && *interfaces != '\0') {
    std::istringstream names(interfaces);
    for (std::string name; std::getline(names, name, ',');) {
      try {
        found.devices.push_back(c10d::ProcessGroupGloo::createDeviceForInterface(name));
      } catch (const std::exception&) {
        throw InputError("GLOO_SOCKET_IFNAME", name.substr(0, 80), "this machine has no such network interface");
      }
    }
    found.description = interfaces;
    return found;
  }
  const std::string towards =
      local ? "127.0.0.1" : (rendezvous.host.empty() ? "" : address_towards(rendezvous.host, rendezvous.port));
  found.devices.push_back(towards.empty() ? c10d::ProcessGroupGloo::createDefaultDevice()
                                          : c10d::ProcessGroupGloo::createDeviceForHostname(towards));
  found.description = towards.empty() ? "the address of " + this_process().host : towards;
  return found;
}

}  // namespace anigen::train
#endif
