//! Certificates of a test authority, the ready configurations with their paths, and sessions that use them.

use super::sessions::session;
use mr_damper_node::streams::sink::zenoh::ZenohConfig;
use rcgen::{BasicConstraints, CertificateParams, DnType, IsCa, Issuer, KeyPair};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::TempDir;
use zenoh::{Session, Wait};

/// A directory with the files that the ready configurations expect: `certs/` and `users.txt`.
pub(crate) struct Keys(TempDir);

impl Keys {
    /// Certificates of `node`, `supervisor` and `reader`, and of `stranger`, which is signed by another authority.
    pub(crate) fn new() -> Self {
        let folder = TempDir::new().expect("a directory");
        std::fs::create_dir(folder.path().join("certs")).expect("an empty directory");
        std::fs::write(folder.path().join("users.txt"), "supervisor:of the four\nreader:of the news\n")
            .expect("writable");
        let keys = Self(folder);
        let (ours, theirs) = (keys.authority("ca"), keys.authority("other-ca"));
        for (name, issuer) in
            [("node", &ours), ("supervisor", &ours), ("reader", &ours), ("stranger", &theirs)]
        {
            let mut params = CertificateParams::new(vec!["localhost".to_owned(), "127.0.0.1".to_owned()])
                .expect("these are names");
            params.distinguished_name.push(DnType::CommonName, name);
            let key = KeyPair::generate().expect("a key");
            let certificate = params.signed_by(&key, issuer).expect("signed");
            keys.write(name, &certificate.pem(), &key);
        }
        keys
    }

    fn authority(&self, name: &str) -> Issuer<'static, KeyPair> {
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        params.distinguished_name.push(DnType::CommonName, name);
        let key = KeyPair::generate().expect("a key");
        let certificate = params.self_signed(&key).expect("signed");
        self.write(name, &certificate.pem(), &key);
        Issuer::new(params, key)
    }

    fn write(&self, name: &str, certificate: &str, key: &KeyPair) {
        std::fs::write(self.path(&format!("certs/{name}.pem")), certificate).expect("writable");
        std::fs::write(self.path(&format!("certs/{name}.key")), key.serialize_pem()).expect("writable");
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Settings with the ready configuration `name`, with absolute paths, listening at `endpoint`.
    pub(crate) fn ready(&self, name: &str, endpoint: &str) -> ZenohConfig {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../launch-configs/zenoh").join(name);
        let text = std::fs::read_to_string(&source).expect("it is in the repository");
        let folder = self.0.path().display();
        let text = text
            .replace("\"certs/", &format!("\"{folder}/certs/"))
            .replace("\"users.txt\"", &format!("\"{folder}/users.txt\""));
        let path = self.path(name);
        std::fs::write(&path, text).expect("writable");
        ZenohConfig { file: Some(path), listen: vec![endpoint.to_owned()], ..ZenohConfig::default() }
    }

    /// A session that connects with TLS and the certificate of `who` (`None`: no certificate), trusting the authority
    /// `trusted`.
    pub(crate) fn tls(&self, endpoint: &str, who: Option<&str>, trusted: &str) -> Session {
        let quoted = |name: String| format!("{:?}", self.path(&name).to_str().expect("UTF-8"));
        let mut settings =
            vec![("transport/link/tls/root_ca_certificate", quoted(format!("certs/{trusted}.pem")))];
        if let Some(who) = who {
            settings.push(("transport/link/tls/enable_mtls", "true".to_owned()));
            settings.push(("transport/link/tls/connect_certificate", quoted(format!("certs/{who}.pem"))));
            settings.push(("transport/link/tls/connect_private_key", quoted(format!("certs/{who}.key"))));
        }
        session(endpoint, &settings)
    }
}

/// A session that connects with a user name and a password.
pub(crate) fn with_password(endpoint: &str, user: &str, password: &str) -> Session {
    let both = format!("{{ user: \"{user}\", password: \"{password}\" }}");
    session(endpoint, &[("transport/auth/usrpwd", both)])
}

/// Number of other sessions that a session is connected to after 1.5 s of tries. The tests expect none, so there is
/// nothing to wait for.
pub(crate) fn connected(session: &Session) -> usize {
    std::thread::sleep(Duration::from_millis(1500));
    session.info().peers_zid().wait().count() + session.info().routers_zid().wait().count()
}
