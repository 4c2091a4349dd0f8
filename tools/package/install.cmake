# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

# Installation: library, headers, program, package for find_package(sparegs), pkg-config. An Embree outside the system's
# folders is added to the run path and sparegs.pc.
include(CMakePackageConfigHelpers)
get_filename_component(SPAREGS_EMBREE_DIR ${EMBREE_LIBRARY} DIRECTORY)
set(SPAREGS_EMBREE_LIBS -lembree${embree_VERSION_MAJOR})
if(NOT SPAREGS_EMBREE_DIR IN_LIST CMAKE_C_IMPLICIT_LINK_DIRECTORIES)
    set(SPAREGS_EMBREE_LIBS "-L${SPAREGS_EMBREE_DIR} ${SPAREGS_EMBREE_LIBS}")
endif()
set(SPAREGS_PACKAGE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/sparegs)
if(NOT BUILD_SHARED_LIBS)
    set(BUILD_SHARED_LIBS OFF) # for sparegs-config.cmake
endif()
install(TARGETS sparegs EXPORT sparegs-targets)
if(TARGET sparegs-cli)
    if(BUILD_SHARED_LIBS)
        file(RELATIVE_PATH SPAREGS_BIN_TO_LIB /${CMAKE_INSTALL_BINDIR} /${CMAKE_INSTALL_LIBDIR})
        set_target_properties(sparegs-cli PROPERTIES INSTALL_RPATH "$ORIGIN/${SPAREGS_BIN_TO_LIB}")
    endif()
    install(TARGETS sparegs-cli)
    if(SPAREGS_PLUGINS)
        install(TARGETS ${SPAREGS_PLUGINS} LIBRARY DESTINATION lib/sparegs)
    endif()
endif()
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/sparegs DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "*.h")
install(EXPORT sparegs-targets NAMESPACE sparegs:: DESTINATION ${SPAREGS_PACKAGE_DIR})
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/sparegs-config.cmake.in ${PROJECT_BINARY_DIR}/sparegs-config.cmake
                              INSTALL_DESTINATION ${SPAREGS_PACKAGE_DIR})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/sparegs-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/sparegs-config.cmake ${PROJECT_BINARY_DIR}/sparegs-config-version.cmake
        DESTINATION ${SPAREGS_PACKAGE_DIR})
# Relative, so that an installation can be moved.
file(RELATIVE_PATH SPAREGS_PC_TO_PREFIX /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
configure_file(${CMAKE_CURRENT_LIST_DIR}/sparegs.pc.in ${PROJECT_BINARY_DIR}/sparegs.pc @ONLY)
install(FILES ${PROJECT_BINARY_DIR}/sparegs.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
