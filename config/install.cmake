# cmake --install and cpack: the program, and the libraries for find_package(Lamina).

function(lamina_install_libraries export)
  set(targets ${ARGN})
  list(TRANSFORM targets PREPEND lamina_)
  install(TARGETS ${targets} EXPORT ${export}
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
  install(EXPORT ${export} NAMESPACE Lamina:: COMPONENT development
    DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/Lamina)
endfunction()

function(lamina_install_headers)
  foreach(folder ${ARGN})
    install(DIRECTORY ${PROJECT_SOURCE_DIR}/${folder}/ COMPONENT development
      DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/lamina/${folder} FILES_MATCHING PATTERN "*.h"
      REGEX "/frontend/pairwise$|/backend/session$" EXCLUDE)
  endforeach()
endfunction()

lamina_install_libraries(LaminaAlgorithms ${LAMINA_ALGORITHMS})
lamina_install_headers(core frontend backend)
if(LAMINA_BUILD_IO)
  lamina_install_libraries(LaminaFiles io session)
  lamina_install_headers(io)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/backend/session COMPONENT development
    DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/lamina/backend FILES_MATCHING PATTERN "*.h")
endif()
if(LAMINA_BUILD_PROGRAM)
  lamina_install_libraries(LaminaConfigurations config)
  lamina_install_headers(config)
endif()

include(CMakePackageConfigHelpers)
configure_package_config_file(${PROJECT_SOURCE_DIR}/config/LaminaConfig.cmake.in
  ${PROJECT_BINARY_DIR}/LaminaConfig.cmake
  INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/Lamina)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/LaminaConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/LaminaConfig.cmake ${PROJECT_BINARY_DIR}/LaminaConfigVersion.cmake
  DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/Lamina COMPONENT development)

function(lamina_install_license package component)
  install(FILES ${PROJECT_SOURCE_DIR}/LICENSE RENAME copyright COMPONENT ${component}
    DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package})
endfunction()

lamina_install_license(lamina-dev development)
if(LAMINA_BUILD_PROGRAM)
  lamina_install_license(lamina program)
  install(TARGETS lamina DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program)
  if(LAMINA_BUILD_LAB)
    install(TARGETS lamina_lab_program DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program)
  endif()
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/config/ DESTINATION ${CMAKE_INSTALL_DATADIR}/lamina/config
    COMPONENT program FILES_MATCHING PATTERN "*.yaml")
  # Where the program is installed is known then: a package is made for another prefix.
  install(CODE "set(PROGRAM_DIR \${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_BINDIR})
    configure_file(${PROJECT_SOURCE_DIR}/config/lamina-watch.service.in
      ${PROJECT_BINARY_DIR}/lamina-watch.service @ONLY)" COMPONENT program)
  install(FILES ${PROJECT_BINARY_DIR}/lamina-watch.service
    DESTINATION ${CMAKE_INSTALL_DATADIR}/lamina/config COMPONENT program)
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/tools/web/ DESTINATION ${CMAKE_INSTALL_DATADIR}/lamina/web
    COMPONENT program)
endif()

if(TARGET lamina_python)
  lamina_install_license(python3-lamina python)
  set(LAMINA_PYTHON_DIR lib/python3/dist-packages CACHE STRING "Where the Python module is installed")
  install(TARGETS lamina_python DESTINATION ${LAMINA_PYTHON_DIR}/lamina COMPONENT python)
  install(FILES ${PROJECT_BINARY_DIR}/python/lamina/__init__.pyi
    ${PROJECT_BINARY_DIR}/python/lamina/py.typed
    DESTINATION ${LAMINA_PYTHON_DIR}/lamina COMPONENT python)
endif()

if(NOT PROJECT_IS_TOP_LEVEL)
  return()
endif()
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME lamina)
set(CPACK_PACKAGE_CONTACT "The Lamina authors <lamina@localhost>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY ${PROJECT_DESCRIPTION})
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
# lamina, lamina-dev with the libraries, python3-lamina.
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL development)
if(LAMINA_BUILD_PROGRAM)
  list(APPEND CPACK_COMPONENTS_ALL program)
endif()
if(TARGET lamina_python)
  list(APPEND CPACK_COMPONENTS_ALL python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-lamina)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
    "python3 (>= ${Python_VERSION_MAJOR}.${Python_VERSION_MINOR}), python3-numpy")
endif()
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME lamina)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS "libjs-three, gnuplot-nox")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME lamina-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "libeigen3-dev, libtbb-dev, libceres-dev, libsuitesparse-dev")
string(CONCAT CPACK_DEBIAN_DEVELOPMENT_PACKAGE_RECOMMENDS
  "libsqlitecpp-dev, libspdlog-dev, libfmt-dev, libyaml-cpp-dev, libdeflate-dev, "
  "libbz2-dev, liblzf-dev, liblz4-dev, libzstd-dev, pkg-config")
include(CPack)
