# Makes the Debian packages, unpacks them, and runs the program from there.
#   cmake -DLAMINA_BUILD=... -DVERSION=... -DPACKAGES=3 -DSCRATCH=... -P package_test.cmake

function(run)
  execute_process(COMMAND ${ARGN} WORKING_DIRECTORY ${SCRATCH}
    RESULT_VARIABLE result OUTPUT_VARIABLE out ERROR_VARIABLE out)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${ARGN}: ${result}\n${out}")
  endif()
  set(output "${out}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${SCRATCH})
file(MAKE_DIRECTORY ${SCRATCH})
run(${CMAKE_CPACK_COMMAND} --config ${LAMINA_BUILD}/CPackConfig.cmake -B ${SCRATCH}/packages
  -D CPACK_DEBIAN_COMPRESSION_TYPE=gzip)
file(GLOB packages ${SCRATCH}/packages/*.deb)
list(LENGTH packages count)
if(NOT count EQUAL PACKAGES)
  message(FATAL_ERROR "${PACKAGES} packages are expected, not: ${packages}")
endif()
foreach(package ${packages})
  run(dpkg-deb -x ${package} ${SCRATCH}/root)
  run(dpkg-deb -f ${package} Package Depends)
  string(APPEND fields "${output}")
endforeach()
if(NOT fields MATCHES "Package: lamina\n" OR NOT fields MATCHES "libtbb12")
  message(FATAL_ERROR "the packages do not say what they need:\n${fields}")
endif()

set(lamina ${SCRATCH}/root/usr/bin/lamina)
run(${lamina} --version)
if(NOT output MATCHES "lamina ${VERSION}")
  message(FATAL_ERROR "lamina --version: ${output}")
endif()
# Both programs, and what they find of their data.
run(${lamina} synth --out ${SCRATCH}/room --scene room --sensor vlp16 --frames 3)
run(${lamina} run --scans ${SCRATCH}/room --out ${SCRATCH}/run --config livox_avia)
if(NOT EXISTS ${SCRATCH}/run/map_surfels.ply)
  message(FATAL_ERROR "the run has left no map:\n${output}")
endif()
foreach(file include/lamina/backend/mapping/mapping.h include/lamina/backend/session/session.h
    share/lamina/config/default.yaml)
  if(NOT EXISTS ${SCRATCH}/root/usr/${file})
    message(FATAL_ERROR "the packages lack ${file}")
  endif()
endforeach()
