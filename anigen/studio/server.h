#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/studio/api.h"

namespace anigen::studio {

struct ServerOptions {
  std::string host = "127.0.0.1";
  int port = 0;                                     ///< 0: any that is free
  std::string token;                                ///< that requests must carry (Access); empty: none
  std::size_t most_bytes = std::size_t{128} << 20;  ///< of a request
  double head_seconds = 30.0;                       ///< that a client may take to send the head of a request
  double job_gigabytes = 0.0, job_minutes = 0.0;    ///< limits of a job, to be told; 0: not known
  std::filesystem::path page;                       ///< folder of index.html; empty: no page
  std::filesystem::path three;      ///< folder of the npm package "three"; empty: the page has no 3D view
  std::filesystem::path validator;  ///< folder of the npm package "gltf-validator"; empty: the page has no verdict
  std::filesystem::path gallery;    ///< folder of example images (*.png); empty: none
  std::filesystem::path openapi;    ///< file of /openapi.json; empty: none
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
  /// Routes beside the page's files: method and path as openapi.json has them, such as {"GET", "/v1/jobs/{id}"}.
  std::vector<std::pair<std::string, std::string>> routes() const;
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
/// Folder of npm's gltf-validator, likewise.
std::filesystem::path find_validator(const std::filesystem::path& page);
/// The file openapi.json: in the page's folder, else above it, as in the checkout.
std::filesystem::path find_openapi(const std::filesystem::path& page);
/// Folder of example images: "gallery" of the page's folder, else examples/creatures of the checkout.
std::filesystem::path find_gallery(const std::filesystem::path& page);

}  // namespace anigen::studio
