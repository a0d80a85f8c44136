# Components of `cmake --install`: `programs` (with the module that needs LibTorch, and the configs),
# `library` (libanigen.so), `development` (headers, CMake package, pkg-config), `weights`.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# The library that others link: everything below anigen/anigen.h in one shared object. Engine, asset and core are taken
# whole, since their functions are its interface.
file(WRITE ${PROJECT_BINARY_DIR}/anigen_shared.cpp "// libanigen.so has no source of its own.\n")
add_library(anigen SHARED ${PROJECT_BINARY_DIR}/anigen_shared.cpp)
add_library(anigen::anigen ALIAS anigen)
set_target_properties(anigen PROPERTIES VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR}
  LIBRARY_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/lib)
foreach(whole anigen_engine anigen_asset anigen_core)
  target_link_options(anigen PRIVATE LINKER:--whole-archive $<TARGET_FILE:${whole}> LINKER:--no-whole-archive)
endforeach()
target_link_options(anigen PRIVATE LINKER:--as-needed)
target_link_libraries(anigen PRIVATE anigen_engine)
target_link_libraries(anigen INTERFACE Eigen3::Eigen)
target_include_directories(anigen INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
  $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
target_compile_features(anigen INTERFACE cxx_std_17)
add_dependencies(programs anigen)
install(TARGETS anigen EXPORT anigen-targets
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT library NAMELINK_COMPONENT development)

get_property(programs DIRECTORY ${PROJECT_SOURCE_DIR}/anigen/apps PROPERTY ANIGEN_PROGRAMS)
install(TARGETS ${programs} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT programs)
if(ANIGEN_WITH_TORCH)
  install(TARGETS anigen-torch LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/anigen COMPONENT library)
endif()
if(TARGET anigen-opencv)
  install(TARGETS anigen-opencv LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/anigen COMPONENT library)
endif()
install(DIRECTORY ${PROJECT_SOURCE_DIR}/configs ${PROJECT_SOURCE_DIR}/experiments
  DESTINATION ${CMAKE_INSTALL_DATADIR}/anigen COMPONENT programs PATTERN results EXCLUDE)
if(TARGET anigen-studio)
  set(studio ${CMAKE_INSTALL_DATADIR}/anigen/studio)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/anigen/studio/page/ DESTINATION ${studio} COMPONENT programs)
  install(FILES ${PROJECT_SOURCE_DIR}/anigen/studio/openapi.json DESTINATION ${studio} COMPONENT programs)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/examples/creatures/ DESTINATION ${studio}/gallery COMPONENT programs)
  # Parts of three.js that the page uses, where the package is (scripts/setup.sh).
  set(three ${PROJECT_SOURCE_DIR}/.cache/node/node_modules/three)
  foreach(file LICENSE build/three.module.js build/three.core.js examples/jsm/loaders/GLTFLoader.js
      examples/jsm/utils/BufferGeometryUtils.js examples/jsm/controls/OrbitControls.js
      examples/jsm/controls/TransformControls.js)
    get_filename_component(folder ${file} DIRECTORY)
    install(FILES ${three}/${file} DESTINATION ${studio}/three/${folder} COMPONENT programs OPTIONAL)
  endforeach()
  # A creature for the first start, made by the weights of this source. Without it one is made at that start.
  if(ANIGEN_WITH_TORCH)
    install(CODE "
      set(first_job \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${studio}/first_job\")
      file(REMOVE_RECURSE \"\${first_job}\")
      set(ENV{ANIGEN_WEIGHTS} \"${PROJECT_SOURCE_DIR}/weights/anigen-small\")
      execute_process(COMMAND $<TARGET_FILE:anigen-studio> --first-job \"\${first_job}\" --quiet RESULT_VARIABLE status)
      if(NOT status EQUAL 0)
        message(WARNING \"the studio comes without a creature for its first start\")
      endif()
    " COMPONENT programs)
  endif()
  set(validator ${PROJECT_SOURCE_DIR}/.cache/node/node_modules/gltf-validator)
  install(FILES ${validator}/gltf_validator.dart.js ${validator}/LICENSE ${validator}/NOTICES
    DESTINATION ${studio}/gltf-validator COMPONENT programs OPTIONAL)
endif()
install(DIRECTORY ${PROJECT_SOURCE_DIR}/integrations/blender ${PROJECT_SOURCE_DIR}/integrations/mcp DESTINATION ${CMAKE_INSTALL_DATADIR}/anigen
  COMPONENT programs)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/weights DESTINATION ${CMAKE_INSTALL_DATADIR}/anigen COMPONENT weights)
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT library)

# The public headers: those of the engine, and the assets that they speak of.
set(headers anigen/anigen.h anigen/core/error.h anigen/core/job.h)
foreach(name files rig animate evaluate render prepare generator)
  list(APPEND headers anigen/engine/${name}.h)
endforeach()
foreach(name rigged_asset animation mesh skeleton skin_weights)
  list(APPEND headers anigen/asset/${name}.h)
endforeach()
foreach(header ${headers})
  get_filename_component(folder ${header} DIRECTORY)
  install(FILES ${PROJECT_SOURCE_DIR}/${header} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/${folder}
    COMPONENT development)
endforeach()

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/anigen)
configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/anigen-config.cmake.in
  ${PROJECT_BINARY_DIR}/anigen-config.cmake INSTALL_DESTINATION ${package}
  PATH_VARS CMAKE_INSTALL_LIBDIR CMAKE_INSTALL_DATADIR)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/anigen-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/anigen-config.cmake ${PROJECT_BINARY_DIR}/anigen-config-version.cmake
  DESTINATION ${package} COMPONENT development)
install(EXPORT anigen-targets NAMESPACE anigen:: DESTINATION ${package} COMPONENT development)
file(RELATIVE_PATH prefix_from_pkgconfig /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
configure_file(${PROJECT_SOURCE_DIR}/cmake/anigen.pc.in ${PROJECT_BINARY_DIR}/anigen.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/anigen.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)
