#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>

#include "anigen/studio/api.h"

namespace anigen::studio {

struct ServerOptions {
  std::string host = "127.0.0.1";
  int port = 0;                                     ///< 0: any that is free
  std::string token;                                ///< that requests must carry (Access); empty: none
  std::size_t most_bytes = std::size_t{128} << 20;  ///< of a request
  std::filesystem::path page;                       ///< folder of index.html; empty: no page
  std::filesystem::path three;    ///< folder of the npm package "three"; empty: the page has no 3D view
  std::filesystem::path gallery;  ///< folder of example images (*.png); empty: none
};

/// The HTTP server of the studio: routes of docs/studio.md. A request that is refused gets {"error": …}.
class Server {
 public:
  /// Listens. @throws InputError when the address cannot be had
  Server(Api& api, const ServerOptions& options);
  ~Server();  ///< as stop()
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  int port() const;
  std::string address() const;  ///< "http://127.0.0.1:8080/", with "?token=…" where one is asked for
  /// Takes no more requests, and waits for those that are being answered.
  void stop();

 private:
  class Work;
  std::unique_ptr<Work> work_;
};

/// Folder of the page: beside the checkout that the program was built in, else share/anigen/studio of its prefix.
/// @param program the executable @return empty: there is none
std::filesystem::path find_page(const std::filesystem::path& program);
/// Folder of three.js: "three" of the page's folder, else the npm package as Node would find it from the page on, also
/// in .cache/node, else in $NODE_PATH.
std::filesystem::path find_three(const std::filesystem::path& page);
/// Folder of example images: "gallery" of the page's folder, else examples/creatures of the checkout.
std::filesystem::path find_gallery(const std::filesystem::path& page);

}  // namespace anigen::studio
