//! Photos to soup.
