//! The token with which this server's own page identifies itself: a random number that is new at every start.

use crate::error::ServeError;

/// The request header that contains the token.
pub(super) const HEADER: &str = "x-mr-damper-token";

/// A token.
#[derive(Clone)]
pub struct Token(String);

impl std::fmt::Debug for Token {
    /// Hides the token, because logs are read by others.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(..)")
    }
}

impl Token {
    /// A new token of 128 random bits.
    ///
    /// # Errors
    /// When the system provides no randomness.
    pub fn new() -> Result<Self, ServeError> {
        let mut bits = [0; 16];
        getrandom::fill(&mut bits).map_err(ServeError::NoRandomNumbers)?;
        Ok(Self(bits.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// The token as text, for the page.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.0
    }

    /// True when `given` equals the token. The time does not depend on where the first wrong character is.
    #[must_use]
    pub fn is(&self, given: &str) -> bool {
        let wrong = self.0.bytes().zip(given.bytes()).fold(0, |wrong, (own, given)| wrong | (own ^ given));
        self.0.len() == given.len() && wrong == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_equals_only_itself_and_is_not_logged() {
        let [one, other] = [(); 2].map(|()| Token::new().expect("randomness"));
        assert!(one.is(one.text()) && !one.is(other.text()) && !one.is("") && !one.is(&one.text()[1..]));
        assert!(!one.is(&format!("{}0", one.text())));
        assert_eq!((one.text().len(), format!("{one:?}").as_str()), (32, "Token(..)"));
    }
}
