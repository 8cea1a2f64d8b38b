//! Sets `cfg(mr_damper_hardened)` when `node/hardened/build` builds with the edited DDS libraries, which offer more
//! functions.

fn main() {
    println!("cargo::rustc-check-cfg=cfg(mr_damper_hardened)");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=MR_DAMPER_HARDENED");
    if std::env::var_os("MR_DAMPER_HARDENED").is_some() {
        println!("cargo::rustc-cfg=mr_damper_hardened");
    }
}
