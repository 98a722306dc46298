//! What the build knows and the module tells of itself.

use std::env;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let rustc = env::var("RUSTC").unwrap_or_default();
    let version = Command::new(rustc).arg("--version").output().map(|out| out.stdout).unwrap_or_default();
    println!("cargo::rustc-env=BUILD_RUSTC={}", String::from_utf8_lossy(&version).trim());
    for name in ["PROFILE", "TARGET"] {
        println!("cargo::rustc-env=BUILD_{name}={}", env::var(name).unwrap_or_default());
    }
}
