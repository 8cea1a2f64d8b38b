//! A Zenoh router with a storage, made of Zenoh's own parts: equivalent to `zenohd` with `zenoh-plugin-storage-manager`.
//!
//! ```text
//! fleet-router launch-configs/zenoh/storage.json5
//! ```

use zenoh::Config;
use zenoh::internal::plugins::PluginsManager;
use zenoh::internal::runtime::RuntimeBuilder;
use zenoh_plugin_storage_manager::StoragesPlugin;

#[tokio::main]
async fn main() -> zenoh::Result<()> {
    zenoh::init_log_from_env_or("warn");
    let file = std::env::args().nth(1).ok_or("usage: fleet-router CONFIG.json5")?;
    let config = Config::from_file(file)?;
    let mut plugins = PluginsManager::static_plugins_only();
    // The plugin panics without a configuration, so it is declared only if configured.
    if config.get_json("plugins/storage_manager").is_ok_and(|json| json != "null") {
        plugins.declare_static_plugin::<StoragesPlugin, &str>("storage_manager", true);
    }
    let mut runtime = RuntimeBuilder::new(config).plugins_manager(plugins).build().await?;
    runtime.start().await?;
    tokio::signal::ctrl_c().await?;
    runtime.close().await
}
